"""The rules that turn what was said of a claim into its class, its odds and what it depends on."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from losbench.papers.provenance import Calibration
from losbench.workbench.ledger.claims import Claim, with_error
from losbench.workbench.ledger.entries import (
    Arithmetic,
    Block,
    Ends,
    Open,
    Said,
    Set,
    Statement,
    Value,
)

__all__ = ["Verdict", "holm", "ids", "meets", "odds_of", "verdict_of"]

MARGIN = 3.0  # standard errors
RARE = 0.0027  # what lies outside three of them
WANTED_ODDS = 100.0
LEVEL = 0.05
_MOST_ODDS = 1e6


@dataclass(frozen=True)
class Verdict:
    """What became of a claim, for a row of the ledger."""

    verdict: str = "pending"
    under: str = ""
    ours: str = ""
    odds: float | None = None
    depends_on: tuple[str, ...] = ()
    reason: str = ""


def meets(claim: Claim, said: Value | Statement) -> bool:
    """Whether our value, with its error, and the print, with its rounding, have anything in
    common.
    """
    if isinstance(said, Statement):
        return said.p > RARE
    if isinstance(said.value, bool):
        return said.value == (claim.claimed == "true")
    low, high = said.printed or claim.interval
    margin = MARGIN * said.error
    return low <= said.value + margin and said.value - margin <= high


def odds_of(claim: Claim, said: Value | Statement) -> float | None:
    """Likelihood of the print under our value over that under the null, or None without a null.

    One rule for numbers and statements: the print is an interval of its rounding, one side of an
    inequality, or true.
    """
    if isinstance(said, Statement):
        if said.p_null is None:
            return None
        ratio = np.log(max(said.p, 1e-12)) - np.log(max(said.p_null, 1e-12))
    elif said.null is None:
        return None
    elif isinstance(said.value, bool):
        ratio = 99.0 * (int(said.value) - int(bool(said.null)))
    else:
        interval = said.printed or claim.interval
        null_error = said.error if said.null_error is None else said.null_error
        ratio = _log_chance(interval, said.value, said.error) - _log_chance(
            interval, float(said.null), null_error
        )
    return float(np.exp(np.clip(ratio, -np.log(_MOST_ODDS), np.log(_MOST_ODDS))))


def _log_chance(interval: tuple[float, float], value: float, error: float) -> float:
    """Log probability that a normal value falls into the interval, good far out in its tails."""
    low, high = interval
    if error == 0.0:
        return 0.0 if low <= value <= high else -1e9
    a, b = (low - value) / error, (high - value) / error
    if a > 0:
        a, b = -b, -a
    upper, lower = log_ndtr(b), log_ndtr(a)
    # A difference of tails in logarithms: a narrow interval far out would be 0 - 0.
    return float(upper + np.log(-np.expm1(min(lower - upper, -1e-12))))


def holm(p_values: Mapping[str, float], count: int) -> dict[str, float]:
    """Level at which each block is tested: Holm's steps at 5 % over ``count`` blocks.

    >>> holm({"a": 0.5, "b": 1e-9}, 10)
    {'b': 0.005, 'a': 0.005555555555555556}
    """
    order = sorted(p_values, key=lambda name: p_values[name])
    return {name: LEVEL / max(count - k, 1) for k, name in enumerate(order)}


def ids(claims: Iterable[str], order: Sequence[str]) -> tuple[str, ...]:
    """Return claims in the ledger's order, runs of three or more as one, e.g. irls-32..43."""
    place = {id_: k for k, id_ in enumerate(order)}
    known = sorted({place[c] for c in claims})
    runs: list[list[int]] = []
    for k in known:
        if runs and k == runs[-1][-1] + 1 and _family(order[k]) == _family(order[runs[-1][-1]]):
            runs[-1].append(k)
        else:
            runs.append([k])
    out: list[str] = []
    for run in runs:
        names = [order[k] for k in run]
        out += [f"{names[0]}..{names[-1].rpartition('-')[2]}"] if len(run) > 2 else names
    return tuple(out)


def _family(id_: str) -> str:
    return id_.rpartition("-")[0]


def verdict_of(
    claim: Claim,
    said: Sequence[Said],
    *,
    levels: Mapping[str, float],
    fields: Mapping[str, Calibration],
    order: Sequence[str],
) -> Verdict:
    """Judge one claim.

    Parameters
    ----------
    claim : Claim
    said : sequence
        All that was said of it.
    levels : mapping
        Level of each block, by `holm`.
    fields : mapping
        The calibrated fields.
    order : sequence of str
        All ids.
    """
    values = [one for one in said if isinstance(one, Value | Statement)]
    arithmetic = [one for one in said if isinstance(one, Arithmetic)]
    questions = [one for one in said if isinstance(one, Open)]
    sets = [one for one in said if isinstance(one, Set)]
    blocks = [one for one in said if isinstance(one, Block)]
    ends = {one.field: one for one in said if isinstance(one, Ends)}

    judged = _readings(claim, values, blocks, levels)
    held = sum(one.meets for one in judged)
    odds = [o for v in values if (o := odds_of(claim, v)) is not None]
    reads = values[0].reads if values else frozenset()
    loose, turned = _calibration(claim, values, reads & set(fields), ends)
    if arithmetic:
        kind = "arithmetic"
    elif questions:
        kind = "open"
    elif sets or any(claim.id in fields[name].to for name in loose):
        kind = "set"
    elif judged and (loose or any(v.made_of for v in values)):
        kind = "follows"
    else:
        kind = _by_evidence(judged)
    depends = {c for name in reads & set(fields) for c in fields[name].to}
    depends |= {c for one in (*values, *blocks) for c in one.uses}
    depends |= {c for one in values for c in one.made_of}
    depends |= {c for one in arithmetic for c in one.from_}
    reasons = [
        *(
            f"the paper's own prints: {'true' if one.holds else 'false'}"
            + (f"; {one.note}" if one.note else "")
            for one in arithmetic
        ),
        *(f"{one.question}" + (f" ({one.note})" if one.note else "") for one in questions),
        *(f"set {one.field}" for one in sets),
        *_said_of_readings(judged),
        *turned,
        *(f"{name} was not varied" for name in sorted(loose - set(ends)) if kind == "follows"),
        *dict.fromkeys(one.note for one in (*values, *blocks) if one.note),
    ]
    return Verdict(
        verdict=kind,
        under=f"{held} of {len(judged)}" if judged and not arithmetic and not questions else "",
        ours=_range(values),
        odds=odds[0] if odds else None,
        depends_on=ids(depends - {claim.id}, order),
        reason=". ".join(reasons),
    )


@dataclass(frozen=True)
class _Judged:
    """One reading: whether the print stands under it, and whether it might have fallen."""

    words: str
    meets: bool
    convincing: bool


def _readings(
    claim: Claim,
    values: Sequence[Value | Statement],
    blocks: Sequence[Block],
    levels: Mapping[str, float],
) -> list[_Judged]:
    fits = [b for b in blocks if b.fitted]
    if fits:  # A cell that went into a fit cannot be judged on its own.
        held = [b.p_value >= levels[b.name] for b in fits]
        return [_Judged(_words(b.reading), ok, ok) for b, ok in zip(fits, held, strict=True)]
    tests = [b.p_value >= levels[b.name] for b in blocks]
    judged = []
    for value in values:
        # A cell differs only where its table does: three sigma happen too often among many cells.
        spared = bool(tests) and all(tests) and isinstance(value, Value) and value.error > 0
        ok = meets(claim, value) or spared
        odds = odds_of(claim, value)
        judged.append(
            _Judged(_words(value.reading), ok, ok and (odds is None or odds >= WANTED_ODDS))
        )
    # Where no reading carries the whole table, a cell that meets under some odd one proves nothing.
    return judged[:1] if tests and not any(tests) else judged


def _calibration(
    claim: Claim,
    values: Sequence[Value | Statement],
    read: Collection[str],
    ends: Mapping[str, Ends],
) -> tuple[set[str], list[str]]:
    """Calibrated fields on which the verdict hangs, or may hang; and what their ends showed."""
    loose, words = set(), []
    for name in sorted(read):
        if name not in ends:
            loose.add(name)
            continue
        here = meets(claim, values[0])
        there = [meets(claim, end) for end in (ends[name].low, ends[name].high)]
        shown = " and ".join(_number(end) for end in (ends[name].low, ends[name].high))
        if all(one == here for one in there):
            words.append(f"stands at both ends of {name}: {shown}")
        else:
            loose.add(name)
            words.append(f"turns with {name}: {shown} at its ends")
    return loose, words


def _by_evidence(judged: Sequence[_Judged]) -> str:
    if not judged:
        return "pending"
    if not any(one.meets for one in judged):
        return "differs"
    if all(one.convincing for one in judged):
        return "agrees"
    if all(one.meets for one in judged) or not any(one.convincing for one in judged):
        return "no power"
    return "depends"


def _words(reading: Mapping[str, str]) -> str:
    return ", ".join(f"{axis}: {choice}" for axis, choice in reading.items())


def _said_of_readings(judged: Sequence[_Judged]) -> list[str]:
    parts = []
    for word, wanted in (("under", True), ("not under", False)):
        some = list(dict.fromkeys(one.words for one in judged if one.meets == wanted))
        some = [words for words in some if words]
        if some:
            more = f" and {len(some) - 6} more" if len(some) > 6 else ""
            parts.append(f"{word} {' | '.join(some[:6])}{more}")
    return parts


def _number(said: Value | Statement) -> str:
    if isinstance(said, Statement):
        return f"true in {_percent(said.p)} %"
    if isinstance(said.value, bool):
        return str(said.value).lower()
    return with_error(said.value, said.error)


def _range(values: Sequence[Value | Statement]) -> str:
    """Our value with its error, or from which to which the readings go."""
    if not values:
        return ""
    unit = next((f" {v.unit}" for v in values if isinstance(v, Value) and v.unit), "")
    if len(values) == 1:
        return _number(values[0]) + unit
    numbers = [
        v.p if isinstance(v, Statement) else v.value
        for v in values
        if isinstance(v, Statement) or not isinstance(v.value, bool)
    ]
    if len(numbers) < len(values):
        true = sum(bool(v.value) for v in values if isinstance(v, Value))
        return f"true in {true} of {len(values)}"
    if isinstance(values[0], Statement):
        ends = dict.fromkeys(_percent(p) for p in (min(numbers), max(numbers)))
        return f"true in {' to '.join(ends)} %"
    return f"{min(numbers):.3g} to {max(numbers):.3g}{unit}"


def _percent(p: float) -> str:
    return "100" if p >= 0.995 else f"{100 * p:.2g}"
