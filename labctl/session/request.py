"""From options to a complete request and its plan, every mistake refused before anything moves."""

import traceback
from dataclasses import dataclass

from labctl.config.design import Design
from labctl.config.load import check_fit
from labctl.config.rig import RigConfig
from labctl.errors import BadInput, LabError
from labctl.ledger.records import RunRequest
from labctl.measurement.decay import FEWEST_SAMPLES
from labctl.measurement.relaxation import STRETCH_S
from labctl.session.contract import Protocol, Trial

MOST_TRIALS = 1000
# A watch that no trial could come out good of.
SHORTEST_WATCH_S = FEWEST_SAMPLES * STRETCH_S
# What is recorded in one go stays of a size that a laptop can read.
LONGEST_WATCH_S = 6 * 3600.0
LONGEST_HOLD_S = 3600.0


@dataclass(frozen=True)
class RunOptions:
    """What was given on the command line; None and empty are left to the protocol."""

    patterns: tuple[str, ...]
    pressures_psi: tuple[float, ...] = ()
    trials: int | None = None
    attempts: int = 3
    placement: str | None = None
    watch_s: float | None = None
    hold_s: float | None = None


def complete(protocol: Protocol, options: RunOptions, design: Design) -> RunRequest:
    """Fill in the protocol's own values.

    Raises:
        BadInput: the protocol does not take what the options give.
    """
    has = f"; design {design.name} ({design.source}) has {', '.join(sorted(design.patterns))}"
    _require_count(protocol, "--pattern", len(options.patterns), protocol.allowed.patterns, has)
    pressures_psi = options.pressures_psi or protocol.pressures_psi
    _require_count(protocol, "--pressure", len(pressures_psi), protocol.allowed.pressures)
    for name, values in (("pattern", options.patterns), ("pressure", pressures_psi)):
        if len(set(values)) < len(values):
            raise BadInput(f"{protocol.name}: a {name} is named twice: {', '.join(map(str, values))}")
    for pattern in options.patterns:
        if not design.jammed(pattern):
            raise BadInput(f"pattern {pattern!r} of design {design.name} ({design.source}) stiffens no fiber")
    if options.watch_s is not None and protocol.watch_s is None:
        raise BadInput(f"{protocol.name} does not watch the sheet after venting: leave --watch out")
    if options.watch_s is not None and options.watch_s < SHORTEST_WATCH_S:
        raise BadInput(
            f"--watch {options.watch_s:g} s is below {SHORTEST_WATCH_S:g} s: it gives fewer than {FEWEST_SAMPLES} "
            "heights, from which no time constant can be had"
        )
    if options.watch_s is not None and options.watch_s > LONGEST_WATCH_S:
        raise BadInput(
            f"--watch {options.watch_s:g} s is above {LONGEST_WATCH_S:g} s; watch a sheet that creeps for longer in "
            "several trials"
        )
    if options.hold_s is not None and not protocol.can_hold:
        raise BadInput(f"{protocol.name} does not hold a pressure for a time of yours: leave --hold out")
    if options.hold_s is not None and not 0 < options.hold_s <= LONGEST_HOLD_S:
        raise BadInput(f"--hold {options.hold_s:g} s must be above 0 and at most {LONGEST_HOLD_S:g} s")
    trials = protocol.trials if options.trials is None else options.trials
    fewest, most = protocol.allowed.trials
    if not fewest <= trials <= most:
        allowed = f"{fewest}" if fewest == most else f"{fewest} to {most}"
        raise BadInput(
            f"{protocol.name} does {allowed} trial{'s' if most > 1 else ''} of each kind, and --trials is {trials}; "
            "five-trial repeats a measurement"
        )
    return RunRequest(
        protocol=protocol.name,
        patterns=options.patterns,
        pressures_psi=pressures_psi,
        trials=trials,
        attempts=options.attempts,
        placements=_placements(protocol, options, design),
        watch_s=protocol.watch_s if options.watch_s is None else options.watch_s,
        hold_s=options.hold_s,
    )


def plan(protocol: Protocol, request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    """The trials, each step checked against the rig's limits and valves.

    Raises:
        BadInput: a pressure that this rig must not go to, a fiber without a valve, no trial at all, not numbered
            from 1, or without steps or teardown.
        LabError: the protocol cannot make its plan.
    """
    check_fit(design, rig)
    trials = _planned(protocol, request, design, rig)
    if not 0 < len(trials) <= MOST_TRIALS:
        raise BadInput(f"{protocol.name}: its plan has {len(trials)} trials; 1 to {MOST_TRIALS} can be run")
    if [trial.number for trial in trials] != list(range(1, len(trials) + 1)):
        raise BadInput(
            f"{protocol.name}: its plan does not number its {len(trials)} trials from 1 on, in order"
        )
    for trial in trials:
        if not trial.checklist.setup + trial.checklist.main or not trial.checklist.teardown:
            raise BadInput(
                f"{protocol.name}: trial {trial.number} has nothing to do or no teardown; every trial ends with "
                "vent_and_unjam"
            )
        for step in trial.checklist.steps:
            if step.pressure_psi is not None:
                rig.limits.check_pressure(step.pressure_psi, rig.source)
            beyond = sorted(channel for channel in step.channels if channel > rig.valves.channels)
            if beyond:
                raise BadInput(
                    f"step '{step.description}' opens channel {beyond[0]}, and {rig.source} has valves.channels = "
                    f"{rig.valves.channels}"
                )
    return trials


def _planned(protocol: Protocol, request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    try:
        return tuple(protocol.plan(request, design, rig))
    except LabError:
        raise
    # A laboratory's own package may fail in any way.
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        raise LabError(
            f"protocol {protocol.name!r} made no plan: {error!r} ({place.filename}, line {place.lineno})"
        ) from error


def _require_count(
    protocol: Protocol, option: str, given: int, takes: tuple[int, int], has: str = ""
) -> None:
    least, most = takes
    if not least <= given <= most:
        allowed = f"{least}" if least == most else f"{least} to {most}"
        raise BadInput(
            f"{protocol.name} takes {allowed} {option}, {given} given; repeat the option for each{has}"
        )


def _placements(protocol: Protocol, options: RunOptions, design: Design) -> tuple[str, ...]:
    """How the fibers lie on the sheet, in the terms of Table III."""
    if protocol.placements is not None:
        if options.placement is not None:
            raise BadInput(f"{protocol.name} names its own placements: leave --placement out")
        return protocol.placements(options.patterns)
    if options.placement is not None:
        # It heads a row of every table.
        if not options.placement.strip() or not options.placement.isprintable():
            raise BadInput(f"--placement {options.placement!r}: write a short name, in one line")
        return (options.placement,)
    used = frozenset().union(*(design.jammed(pattern) for pattern in options.patterns))
    is_neat = used == {fiber.id for fiber in design.fibers}
    return ("neat" if is_neat else "combined",)
