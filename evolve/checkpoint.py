"""Where a search stands, between two generations, as a file that is written whole or not at all."""

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from evolve.afpo import AfpoState
from evolve.errors import EvolveError
from evolve.evaluation import Counts
from evolve.front import Front
from evolve.genome import FiberGene, Genome
from evolve.selection import Member

FORMAT, VERSION = "labctl evolve checkpoint", 1


@dataclass(frozen=True)
class GenerationRecord:
    """One line of a search's progress; errors in metres, one a target, over members whose sheets have shapes.

    `best_m`: the smallest of the front; `mean_m`, `sd_m`: of the population; `hypervolume` of the front;
    counts and seconds from the beginning of the search.
    """

    generation: int
    best_m: tuple[float, ...]
    mean_m: tuple[float, ...]
    sd_m: tuple[float, ...]
    front: int
    hypervolume: float
    counts: Counts
    seconds: float


@dataclass(frozen=True)
class Checkpoint:
    """The state of the search, its front, its progress, and `random_m`: errors of random layouts, in metres."""

    state: AfpoState
    front: Front
    records: tuple[GenerationRecord, ...]
    random_m: tuple[tuple[float, ...], ...]


def save_checkpoint(path: Path, checkpoint: Checkpoint, run: str) -> None:
    """Write a checkpoint of the run of that digest; it is on the disk when this returns, or an OSError is raised."""
    body = {
        "state": _state_to_json(checkpoint.state),
        "front": [member_to_json(member) for member in checkpoint.front.members],
        "records": [asdict(record) for record in checkpoint.records],
        "random_m": checkpoint.random_m,
    }
    head = {"format": FORMAT, "version": VERSION, "run": run, "sha256": _digest(body)}
    write_atomically(path, json.dumps(head | {"body": body}).encode())


def load_checkpoint(path: Path, run: str) -> Checkpoint:
    """The checkpoint of the run of that digest.

    Raises:
        EvolveError: it cannot be read, is cut short, changed, of another version or of another run.
    """
    refused = f"{path}: nothing was overwritten; "
    try:
        data = json.loads(path.read_bytes())
    except OSError as error:
        raise EvolveError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise EvolveError(
            f"{refused}the checkpoint is cut short or damaged ({error}): put back a whole one, or begin anew in "
            "another folder"
        ) from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise EvolveError(f"{refused}this is not a checkpoint of a search: name the folder of a run")
    if data.get("version") != VERSION:
        raise EvolveError(
            f"{refused}the checkpoint is of version {data.get('version')}, this program reads version {VERSION}: "
            "resume it with the program that wrote it"
        )
    if data.get("run") != run:
        raise EvolveError(
            f"{refused}the checkpoint belongs to a run with other settings than run.json beside it: put the two "
            "that belong together into one folder"
        )
    if data.get("sha256") != _digest(data.get("body")):
        raise EvolveError(
            f"{refused}the checkpoint was changed after it was written: its checksum does not fit; put back a "
            "whole one, or begin anew in another folder"
        )
    try:
        return _checkpoint(data["body"])
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise EvolveError(
            f"{refused}the checkpoint is not what this program writes ({type(error).__name__}: {error}): put back a "
            "whole one, or begin anew in another folder"
        ) from error


def member_to_json(member: Member) -> dict[str, Any]:
    """A member as JSON can hold it; fibers as (face, start, end, patterns)."""
    return {
        "id": member.id,
        "age": member.age,
        "errors_m": member.errors_m,
        "made_by": member.made_by,
        "fibers": [[fiber.face, fiber.start, fiber.end, sorted(fiber.patterns)] for fiber in member.genome],
    }


def write_atomically(path: Path, content: bytes) -> None:
    """Replace a file by new content, whole or not at all, also where the power goes.

    Raises:
        OSError: it could not be written, with its path; what was there still is.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        # On a full disk it holds room that the next try needs.
        with suppress(OSError):
            unfinished.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error


def _digest(body: object) -> str:
    return sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _state_to_json(state: AfpoState) -> dict[str, Any]:
    return {
        "generation": state.generation,
        "next_id": state.next_id,
        "population": [member_to_json(member) for member in state.population],
        "variation_rng": state.variation_rng,
        "selection_rng": state.selection_rng,
    }


def _checkpoint(body: Mapping[str, Any]) -> Checkpoint:
    state = body["state"]
    return Checkpoint(
        AfpoState(
            state["generation"],
            state["next_id"],
            _members(state["population"]),
            state["variation_rng"],
            state["selection_rng"],
        ),
        Front(_members(body["front"])),
        tuple(_record(record) for record in body["records"]),
        tuple(tuple(errors_m) for errors_m in body["random_m"]),
    )


def _members(data: Sequence[Mapping[str, Any]]) -> tuple[Member, ...]:
    return tuple(
        Member(
            member["id"],
            _genome(member["fibers"]),
            member["age"],
            None if member["errors_m"] is None else tuple(member["errors_m"]),
            member["made_by"],
        )
        for member in data
    )


def _genome(fibers: Sequence[Any]) -> Genome:
    return tuple(
        FiberGene(face, (start[0], start[1]), (end[0], end[1]), frozenset(patterns))
        for face, start, end, patterns in fibers
    )


def _record(data: Mapping[str, Any]) -> GenerationRecord:
    return GenerationRecord(
        data["generation"],
        tuple(data["best_m"]),
        tuple(data["mean_m"]),
        tuple(data["sd_m"]),
        data["front"],
        data["hypervolume"],
        Counts(**data["counts"]),
        data["seconds"],
    )
