"""Tallies of several processes made one, and what is said of many times."""

from dataclasses import fields

_MOST = {"longest_s", "highest_psi"}


def merged(tallies):
    """One tally of several of the same subject: counts are added, lists joined, the worst of what is a worst."""
    first, *others = tallies
    for other in others:
        for part in fields(first):
            setattr(
                first, part.name, _merged(part.name, getattr(first, part.name), getattr(other, part.name))
            )
    return first


def _merged(name, one, other):
    if isinstance(one, str):
        return one
    if isinstance(one, dict):
        return {key: one.get(key, 0) + other.get(key, 0) for key in {**one, **other}}
    return max(one, other) if name in _MOST else one + other


def percentile(values, percent):
    """Of the values sorted, the one that so many per cent are not above; 0 of none."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))] if ordered else 0.0


def times(values):
    """Median, 99th percentile and longest, for people."""
    if not values:
        return "-"
    return f"{percentile(values, 50):.2f} / {percentile(values, 99):.2f} / {max(values):.2f}"
