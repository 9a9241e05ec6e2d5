"""To SAFE on a rig that another process holds: asked of it, watched, and done in its place where it does not answer.

As the guard does with a program that hangs: the process is ended, which frees its ports, and the rig is vented from
here, with patience for the guard, which does the same at the same time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from labctl.clock import Scheduler
from labctl.config.rig import Limits
from labctl.errors import LabError, NoAnswer
from labctl.holder.interfaces import Conversation, Held, Holders, Holding, RigHeld
from labctl.holder.records import Holder, RigState, SafeReading
from labctl.links.wires import Wires
from labctl.safety.reach import PERHAPS_IN_USE, Reach, open_and_make_safe
from labctl.safety.safe_state import SafeReport

ANSWER_S = 1.0
# An opening that is under way ends, or becomes an open rig, within this; so does a look at the instruments.
_OPENING_S = 5.0
_MARGIN_S = 10.0
_BUSY_S = 30.0
_LOOK_S = 0.02


@dataclass(frozen=True)
class Vented:
    """What was read back, and by whom: "holder", or "here" where it did not answer or was gone."""

    holder: Holder
    report: SafeReport
    by: Literal["holder", "here"]


@dataclass(frozen=True)
class From:
    """The process that vents: who it is, and what it works with. `notify` gets one line for each event."""

    holder: Holder
    holders: Holders
    scheduler: Scheduler
    wires: Wires
    notify: Callable[[str], None]


def vent_held(held: Held, asked: Conversation | NoAnswer, here: From) -> Vented:
    """Have a held rig taken to SAFE, by its holder or in its place; the holder's command ends.

    `asked` is what became of the request to vent: the conversation, which is closed here, or that it was not taken.

    Raises:
        LabError: it does not answer and cannot be ended from here.
    """
    holder = held.entry.holder
    here.notify(f"{holder.rig_name} is held by {holder.describe()}")
    if holder.kind == "guard":
        here.notify(f"that guard is taking it to SAFE; waiting until it has, {_BUSY_S:g} s at most")
    else:
        try:
            report = _watch(asked, held, here)
        except NoAnswer as silence:
            here.notify(f"{silence}: ending it and venting from here")
            held.end()
        else:
            if report is not None:
                return Vented(holder, report, "holder")
            here.notify(f"process {holder.pid} has let go of the rig: venting from here")
    return Vented(holder, _vent_here(held, Reach.from_plain(held.entry.reach), here), "here")


def _watch(asked: Conversation | NoAnswer, held: Held, here: From) -> SafeReport | None:
    """What the holder read back; None where it let go of the rig without an answer.

    Raises:
        NoAnswer: it has not answered for a second, or has not come to an end.
    """
    if isinstance(asked, NoAnswer):
        raise asked
    try:
        return _until_read_back(asked, held, _longest_vent_s(held), here)
    finally:
        asked.close()


def _longest_vent_s(held: Held) -> float:
    """How long the holder may take, by the wall's clock; what another labctl wrote need not be readable for that."""
    try:
        reach = Reach.from_plain(held.entry.reach)
    except LabError:
        return Limits.vent_timeout_s
    return reach.limits.vent_timeout_s / reach.speed


def _until_read_back(
    conversation: Conversation, held: Held, longest_s: float, here: From
) -> SafeReport | None:
    start_s = here.scheduler.now_s()
    end_s = start_s + longest_s + _MARGIN_S
    pid = held.entry.holder.pid
    state, opening_s = None, start_s
    while (latest := conversation.next_state(ANSWER_S)) is not None:
        if state is None:
            here.notify(f"process {pid} answers: venting{_described(latest)}")
        state = latest
        if state.read_back is not None:
            return _as_report(state.read_back)
        now_s = here.scheduler.now_s()
        if state.venting:
            opening_s = now_s
        elif state.phase == "opening" and now_s - opening_s > _OPENING_S:
            raise NoAnswer(f"process {pid} answers, and has neither opened the rig nor let go of it")
        # One that opens the ports for it has the patience with them that this process would have.
        if now_s > end_s + (_BUSY_S if state.venting else 0.0):
            raise NoAnswer(f"process {pid} answers, and has read nothing back for {now_s - start_s:.0f} s")
    return None


def _described(state: RigState) -> str:
    """Where the holder was when it was asked, as text."""
    pressure = "" if state.pressure_psi is None else f" from {state.pressure_psi:.2f} psi"
    return f"{pressure} (it was at: {state.step})" if state.step else pressure


def _vent_here(held: Held, reach: Reach, here: From) -> SafeReport:
    """Vent from here, once the holder is gone and nobody else, the guard, is at it."""
    holding = _hold(held, here)
    try:
        return open_and_make_safe(
            reach,
            here.scheduler,
            here.wires,
            patience_s=_BUSY_S,
            patient_with=PERHAPS_IN_USE,
            notify=here.notify,
        )
    finally:
        if holding is not None:
            holding.release()


def _hold(held: Held, here: From) -> Holding | None:
    """The rig's hold once it is free; None where it does not come to be: the ports may be free all the same."""
    entry, end_s = held.entry, here.scheduler.now_s() + _BUSY_S
    while True:
        try:
            return here.holders.hold(here.holder, entry.addresses, entry.reach, None, 0.0)
        except RigHeld as error:
            guard = error.held.entry.holder.kind == "guard"
            if here.scheduler.now_s() > end_s or not (guard or error.held.entry.holder == entry.holder):
                return None
        except LabError:
            return None
        here.scheduler.sleep(_LOOK_S)


def _as_report(reading: SafeReading) -> SafeReport:
    channels_on = None if reading.channels_on is None else frozenset(reading.channels_on)
    return SafeReport(
        reading.pressure_psi,
        reading.setpoint_psi,
        reading.vented_by,
        channels_on,
        reading.problems,
        reading.only_zero_is_off,
    )
