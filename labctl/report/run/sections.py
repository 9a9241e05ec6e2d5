"""What a run's page shows, part by part; a part that the run has nothing for is left out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from labctl.config.design import Design, Face
from labctl.errors import BadInput
from labctl.report.page import Table
from labctl.report.run.errors import errors_figure
from labctl.report.run.group_tables import (
    COMPARISON_NOTE,
    compared_views,
    placements_table,
    published_layout,
)
from labctl.report.run.heights import difference_figure, heights_figure, signed_difference_percent
from labctl.report.run.overlay import apart_figure, heights_table, overlay_figure
from labctl.report.run.pressures import pressure_figures
from labctl.report.run.relaxation import relaxation_figure
from labctl.report.run.sheet_faces import face_figure
from labctl.report.run.text import (
    attempts_table,
    doubts_table,
    group_name,
    group_sentence,
    left_out,
    name,
    points_table,
    signed,
)
from labctl.report.run.view import RunView
from labctl.statistics.group_differences import GroupComparison, compare_placements
from labctl.statistics.summary import Group

_FACES: tuple[Face, ...] = ("top", "bottom")
_SHEET_MM = 140.0
_FACE_CAPTIONS = {
    "top": "Top face, seen from above, in the sheet frame.",
    "bottom": "Bottom face, seen through the sheet from the top, in the sheet frame.",
}


@dataclass(frozen=True, eq=False)
class Shown:
    """A figure with its caption, and what stands for it where it cannot be seen."""

    figure: Figure
    alt: str
    caption: str


@dataclass(frozen=True, eq=False)
class Section:
    """A part of the page; `folded` tables are opened by whoever wants them."""

    title: str
    notes: tuple[str, ...] = ()
    figures: tuple[Shown, ...] = ()
    tables: tuple[tuple[str, Table], ...] = ()
    folded: tuple[tuple[str, Table], ...] = ()
    caption: str = ""


def sections(view: RunView) -> Iterator[Section]:
    """The parts in the order of the page."""
    yield _overview(view)
    yield from _placements(view)
    yield from _heights(view)
    yield from _relaxation(view)
    yield from _pressures(view)


def _overview(view: RunView) -> Section:
    """The sheet, and beside it what each trial came to; every attempt as a table."""
    shown, notes = _sheets(view)
    figure = errors_figure(view)
    if figure is not None:
        shown.append(Shown(figure, "e_t of each trial", _errors_caption(view)))
    if not view.attempts:
        notes.append("No trial was committed.")
    if said := left_out(view):
        notes.append(said)
    tables = [("Every attempt", attempts_table(view))] if view.attempts else []
    doubts = doubts_table(view)
    if doubts.rows:
        tables.append(("Markers that were there and are not taken for seen", doubts))
    return Section("The sheet and the trials", tuple(notes), tuple(shown), tuple(tables))


def _errors_caption(view: RunView) -> str:
    caption = (
        "e_t: mean over the points of |r − s|, each side normalised by its own greatest height "
        "(Parsa et al., RoboSoft 2023, equation 2). The interval is a 95 % bootstrap interval of the mean over trials"
    )
    few = min((group.trials for group in view.summary.groups), default=0)
    if not 1 < few < 10:
        return f"{caption}."
    return f"{caption}; of {few} trials it is too narrow, which Student's t, in the table above, is not."


def _placements(view: RunView) -> Iterator[Section]:
    """The published table's layout, and the placements against each other."""
    if not view.placed or not view.summary.groups:
        return
    tables = [("e_t by fiber placement, mean ± sd over the trials", published_layout(view))]
    compared = placements_table(view)
    if compared.rows:
        tables.append(("Against each other", compared))
    yield Section("Fiber placements", tables=tuple(tables), caption=COMPARISON_NOTE if compared.rows else "")
    for each in compare_placements(view.run, view.trials):
        names = (name(each.one.placement), name(each.other.placement))
        called = f"{name(each.one.pattern)} at {each.one.pressure_psi:.2f}\u00a0psi"
        yield from heights_over_one_another(each, (view, view), names, called)


def compared_sections(views: Sequence[RunView]) -> Iterator[Section]:
    """The heights of the first run over those of each other one, group by group."""
    first = views[0]
    for other, compared in zip(views[1:], compared_views(views), strict=True):
        names = (f"run {first.run.number}", f"run {other.run.number}")
        if names[0] == names[1]:
            names = (f"{names[0]}, first", f"{names[1]}, second")
        for each in compared.groups:
            called = f"{each.one.describe()}; {each.other.describe()}"
            yield from heights_over_one_another(each, (first, other), names, called)


def heights_over_one_another(
    compared: GroupComparison, views: tuple[RunView, RunView], names: tuple[str, str], called: str
) -> Iterator[Section]:
    """Two groups' heights over one another and where they differ; nothing where no point has both."""
    heights = compared.heights
    if heights is None:
        return
    one, other = compared.one, compared.other
    simulated_mm = (
        views[0].run.basis(one.pattern).simulated_mm.get(one.pressure_psi, ()),
        views[1].run.basis(other.pattern).simulated_mm.get(other.pressure_psi, ()),
    )
    mean, rms = signed(heights.mean_difference_mm, 2), f"{heights.rms_difference_mm:.2f}"
    over = f"over the {heights.compared} points that both saw"
    yield Section(
        f"{names[0][:1].upper()}{names[0][1:]} less {names[1]}: {called}",
        (f"Heights differ by {mean}\u00a0mm on average, {rms}\u00a0mm root mean square, {over}.",),
        (
            Shown(
                overlay_figure(heights, names, simulated_mm),
                f"Measured heights of both: {called}",
                "Points in the order of their simulated, else the first's measured, heights. Bars are one standard "
                "deviation over the trials either way. A grey id: not seen by both.",
            ),
            Shown(
                apart_figure(heights, views[0].points, _diameter_mm(views[0])),
                f"Where the heights differ: {called}",
                "The first's mean height less the second's, in mm; orange is higher, purple lower.",
            ),
        ),
        folded=((f"The {len(heights.points)} points as a table", heights_table(heights, names)),),
    )


def _heights(view: RunView) -> Iterator[Section]:
    for group in view.summary.groups:
        trials_mm = [
            level.heights_mm
            for each in view.counted(group)
            if (level := each.level(group.pressure_psi)) is not None
        ]
        if not any(height is not None for height in group.heights_mean_mm):
            continue
        called = group_name(view, group)
        shown = [
            Shown(
                heights_figure(group, view.points, trials_mm),
                f"Measured and simulated heights: {called}",
                _heights_caption(group),
            )
        ]
        if any(abs(value) >= 0 for value in signed_difference_percent(group)):
            shown.append(
                Shown(
                    difference_figure(group, view.points, _diameter_mm(view)),
                    f"Where measured and simulated heights differ: {called}",
                    "Where it is off: measured less simulated mean height, each side in percent of its own greatest, "
                    "as in e_t; orange is too high, purple too low.",
                )
            )
        yield Section(
            f"Heights: {called}",
            (f"{group_sentence(view, group)}.",),
            tuple(shown),
            folded=((f"The {len(view.points)} points as a table", points_table(view, group)),),
        )


def _diameter_mm(view: RunView) -> float:
    return _SHEET_MM if view.design is None else view.design.sheet.diameter_mm


def _heights_caption(group: Group) -> str:
    order = "simulated" if any(height is not None for height in group.simulated_mm) else "measured"
    spread = " Bars are one standard deviation over the trials either way." if group.trials > 1 else ""
    return f"Points in the order of their {order} heights.{spread} A grey id: not seen in any trial."


def _relaxation(view: RunView) -> Iterator[Section]:
    figure = relaxation_figure([each for each in view.attempts if each.counts])
    if figure is not None:
        caption = (
            "Mean height over the points after venting, and rest + amplitude · exp(−t / τ), fitted to its first five "
            "time constants; ± is the standard error of the fit. On the left ten time constants, on the right all of "
            "the time."
        )
        shown = Shown(figure, "Height against time after the vent, with the fit", caption)
        yield Section("Relaxation", figures=(shown,))


def _sheets(view: RunView) -> tuple[list[Shown], list[str]]:
    """The faces that have fibers, the top one in any case, jammed for each pattern; and why one cannot be drawn."""
    if view.design is None:
        return [], [f"The design's text cannot be read by this program: {view.run.design_source}."]
    shown: list[Shown] = []
    notes: list[str] = []
    patterns = dict.fromkeys([*(each.record.pattern for each in view.attempts), *view.run.request.patterns])
    for pattern in patterns:
        for face in _FACES:
            if face == "top" or _has_fibers(view.design, face):
                try:
                    figure = face_figure(view.design, pattern, face, view.points)
                except BadInput as error:
                    notes.append(f"{error}.")
                    break
                caption = f"Jammed for {name(pattern)}. {_FACE_CAPTIONS[face]}"
                shown.append(Shown(figure, f"Fibers of the {face} face, jammed for {pattern}", caption))
    if not _has_fibers(view.design, "bottom"):
        notes.append("All fibers are on the top face.")
    return shown, notes


def _has_fibers(design: Design, face: Face) -> bool:
    return any(fiber.face == face for fiber in design.fibers)


def _pressures(view: RunView) -> Iterator[Section]:
    if not view.attempts:
        return
    missing = tuple(f"Trial {each.name}: {each.missing}." for each in view.attempts if each.missing)
    caption = (
        f"On the right how far the pressure was from the level to hold, ±{view.tolerance_psi:g} psi, just before and "
        "while it was measured; several levels lie over one another."
    )
    figures = tuple(
        Shown(figure, "Pressure against time of each trial", caption)
        for figure in pressure_figures(view.attempts, view.tolerance_psi)
    )
    yield Section("Pressure", missing, figures)
