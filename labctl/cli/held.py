"""Rigs that commands in other terminals hold: which are meant, how they are vented, how they are shown."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from labctl.cli.outcome import Outcome
from labctl.cli.vented import VentedRig
from labctl.errors import BadInput, LabError, NoAnswer
from labctl.next_command import next_command

if TYPE_CHECKING:
    from labctl.holder.interfaces import Conversation, Held
    from labctl.holder.records import RigState
    from labctl.safety.vent_held import From, Vented

_ANSWER_S = 1.0
# A command that only looks, or opens the rig, has read it or let go of it by then.
_READING_S = 3.0
# As limits.stale_after has it where nobody says otherwise: what is older is no present reading.
OLD_S = 1.0


def held_rigs(rig_path: Path | None) -> tuple["Held", ...]:
    """Who holds the rig of this file; every rig that is held by this user where no file is named.

    Raises:
        BadInput: the file cannot be read.
    """
    holders = Outcome.current().holders
    if rig_path is None:
        return holders.all()
    return holders.find(addresses_in(rig_path))


def held_by_file(rig_path: Path | None) -> tuple["Held", ...]:
    """`held_rigs` as far as it is known without reading the file, which takes longer than the word to vent may."""
    holders = Outcome.current().holders
    return tuple(held for held in holders.all() if rig_path is None or _is_of(held, rig_path))


def _is_of(held: "Held", rig_path: Path) -> bool:
    return held.entry.holder.source == str(rig_path.resolve())


def addresses_in(rig_path: Path) -> tuple[str, ...]:
    """The addresses of the rig of a file.

    Raises:
        BadInput: the file cannot be read.
    """
    from labctl.config.load import load_rig
    from labctl.holder.addresses import addresses_of

    config = load_rig(rig_path)
    return addresses_of(config.regulator, config.valves)


def one_held_rig(found: Sequence["Held"], rig_path: Path | None, what: str) -> "Held":
    """The only one of them.

    Raises:
        BadInput: there is none, or several; the message lists them and ends with `what` to do.
    """
    if not found:
        which = "a rig" if rig_path is None else f"the rig of {rig_path}"
        raise BadInput(f"no labctl of yours holds {which} now")
    if len(found) > 1:
        listed = "; ".join(f"{held.entry.holder.source}: {held.entry.holder.describe()}" for held in found)
        raise BadInput(f"{len(found)} rigs are held ({listed}); {what}")
    return found[0]


def vent_rigs(
    found: Sequence["Held"], word: Literal["vent", "abort"], notify: Callable[[str], None]
) -> list[VentedRig]:
    """Vent held rigs, all at once; what cannot be done stands in the report."""
    if not found:
        return []
    # Before the instruments' side is imported, which takes as long as the request may.
    asked = [_ask(held, word) for held in found]
    from labctl.holder.this_holder import this_holder
    from labctl.safety.vent_held import From

    platform = Outcome.current().platform
    scheduler = platform.scheduler
    vented: dict[int, VentedRig] = {}

    def vent_one(index: int) -> None:
        held = found[index]
        holder = held.entry.holder
        me = this_holder("command", holder.rig_name, holder.source, simulated=holder.simulated)
        here = From(me, platform.holders, scheduler, platform.wires, notify)
        vented[index] = _vent_one(held, asked[index], here)

    threads = [
        scheduler.start_thread(lambda index=index: vent_one(index), f"{word} {index}")  # type: ignore[misc]
        for index in range(1, len(found))
    ]
    vent_one(0)
    for thread in threads:
        while not thread.join(1.0):
            pass
    return [vented[index] for index in sorted(vented)]


def same_rig(vented: Sequence[VentedRig], rig_path: Path) -> bool:
    """Whether these are the rig that the file describes now, or what it describes cannot be read."""
    try:
        addresses = set(addresses_in(rig_path))
    except BadInput:
        return True
    return any(addresses & set(rig.held.entry.addresses) for rig in vented)


def _ask(held: "Held", word: Literal["vent", "abort"]) -> "Conversation | NoAnswer":
    if held.entry.holder.kind == "guard":
        return NoAnswer("a guard is asked nothing")
    try:
        return held.ask(word, _ANSWER_S)
    except NoAnswer as error:
        return error


def _vent_one(held: "Held", asked: "Conversation | NoAnswer", here: "From") -> VentedRig:
    from labctl.safety.safe_state import SafeReport
    from labctl.safety.vent_held import vent_held

    try:
        vented: Vented = vent_held(held, asked, here)
    # Of several rigs each is vented, whatever becomes of the others.
    except Exception as error:
        problem = str(error) if isinstance(error, LabError) else repr(error)
        return VentedRig(held, SafeReport(None, None, None, None, (problem,)), by_holder=False)
    return VentedRig(held, vented.report, vented.by == "holder")


def state_of(held: "Held") -> "RigState":
    """What the holder says now; of one that is just opening the rig, once it has read it.

    Raises:
        LabError: it does not answer, or is a guard, which answers nobody.
    """
    if held.entry.holder.kind == "guard":
        raise LabError(silent(held))
    clock = Outcome.current().platform.scheduler
    try:
        conversation = held.ask("watch", _ANSWER_S)
        try:
            end_s = clock.now_s() + _READING_S
            state = None
            while (latest := conversation.next_state(_ANSWER_S)) is not None:
                state = latest
                if state.phase != "opening" or state.pressure_psi is not None or clock.now_s() > end_s:
                    break
        finally:
            conversation.close()
    except NoAnswer as error:
        raise LabError(f"{error}; {silent(held)}") from error
    if state is None:
        raise LabError(f"process {held.entry.holder.pid} is just letting go of the rig; try again")
    return state


def silent(held: "Held") -> str:
    """What there is to say of a holder that does not answer, and what to do."""
    holder = held.entry.holder
    if holder.kind == "guard":
        return (
            f"{holder.rig_name} is being taken to SAFE by {holder.describe()}; it reports there and in the system "
            f"log. Wait for it, or type {next_command('vent')}, which waits and then looks"
        )
    return (
        f"{holder.rig_name} is held by {holder.describe()}, which does not answer: it is busy, stopped or hangs. "
        f"{next_command('vent')} ends it and takes the rig to SAFE"
    )


def format_age(age_s: float | None, who: str) -> str:
    """How old a reading is, as text behind it; "" for one that is as new as those that come all the time."""
    if age_s is None or age_s < OLD_S:
        return ""
    return f", read {age_s:.0f} s ago: {who} not answer"


def state_lines(state: "RigState") -> list[str]:
    """A state as text."""
    trial = f", trial {state.trial} of {state.trials}" if state.trial is not None else ""
    run = f"run {state.run} ({state.protocol}{trial}): " if state.run is not None else ""
    step = (state.step or state.holder.command).removeprefix(f"trial {state.trial}: ")
    lines = [
        f"held by   {state.holder.describe()}",
        f"doing     {run}{step} {state.detail}".rstrip(),
    ]
    if state.pressure_psi is None:
        lines.append(
            "pressure  not read: " + ("its port is not open" if state.phase == "closed" else "opening")
        )
    else:
        age = format_age(state.reading_age_s, "the regulator does")
        lines.append(f"pressure  {state.pressure_psi:.2f} psi, setpoint {state.setpoint_psi:.2f} psi{age}")
        lines.append(f"flags     {' '.join(state.flags) or 'none'}")
    if state.channels_on is not None:
        lines.append(f"valves    {', '.join(map(str, state.channels_on)) or 'none'} on")
    if state.markers is not None:
        age = format_age(state.marker_age_s, "the markers' source does")
        lines.append(f"markers   {state.markers_seen} of {state.markers} seen{age}")
    if state.asked_by is not None:
        lines.append(f"stopping  {state.asked_by}")
    return lines


def condition(state: "RigState") -> str:
    """SAFE, as it was read back; else what there is to say instead."""
    safe = state.read_back or state.safe
    if safe is not None:
        return "SAFE" if safe.safe else f"NOT SAFE: {'; '.join(safe.problems)}"
    return "not open" if state.pressure_psi is None else "ENERGISED, or not yet read back SAFE"
