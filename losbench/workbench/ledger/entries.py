"""What notebooks say about claims. Entries hold findings; no entry holds a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypeAlias

from losbench.checks import number

__all__ = [
    "Arithmetic",
    "Block",
    "Conflict",
    "Ends",
    "Entry",
    "Open",
    "Question",
    "Said",
    "Set",
    "Statement",
    "Value",
    "entry_from",
]


@dataclass(frozen=True)
class Value:
    """Our number for a claim under one reading of the paper.

    Parameters
    ----------
    reading : mapping of str to str
        What had to be read into the paper, e.g. ``{"c": "run", "layout": "oblique"}``.
    value : float, in the claim's unit, or bool
        A bool for the claims whose relation is "is".
    error : float
        One-sigma sampling error at the paper's sample size; three of them are allowed.
    null : float, optional
        What the same computation gives where the method does nothing (EIWA = grey, IRLS = LS, no
        aid, no correction).
    null_error : float, optional
        Its error, taken equal to ours unless given.
    reads : frozenset of str
        Fields of scenarios that were used, from `fields_read`.
    printed : (low, high), optional
        The print in the value's own terms where that is not the claim's number, e.g. the paired
        reduction that two cells imply, with their rounding.
    unit : str
        Of ``printed``.
    uses : tuple of str
        Claims whose printed numbers went in.
    made_of : tuple of str
        Claims that it only restates: it then follows from them.
    note : str
        What else a reader should know.

    Examples
    --------
    >>> Value({"statistic": "peak"}, 0.557, 0.02).error
    0.02
    """

    reading: Mapping[str, str]
    value: float | bool
    error: float = 0.0
    null: float | bool | None = None
    null_error: float | None = None
    reads: frozenset[str] = frozenset()
    printed: tuple[float, float] | None = None
    unit: str = ""
    uses: tuple[str, ...] = ()
    made_of: tuple[str, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        """Refuse what is no number."""
        if not isinstance(self.value, bool):
            number("value", self.value)
        number("error", self.error, low=0.0)
        for name in ("uses", "made_of"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "reads", frozenset(self.reads))
        if self.printed is not None:
            object.__setattr__(self, "printed", tuple(float(end) for end in self.printed))


@dataclass(frozen=True)
class Statement:
    """How often a statement is true: in draws of the twin, and in draws where the method does
    nothing.
    """

    reading: Mapping[str, str]
    p: float
    p_null: float | None = None
    reads: frozenset[str] = frozenset()
    uses: tuple[str, ...] = ()
    made_of: tuple[str, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        """Refuse what is no probability."""
        number("p", self.p, low=0.0, high=1.0)
        if self.p_null is not None:
            number("p_null", self.p_null, low=0.0, high=1.0)
        for name in ("uses", "made_of"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "reads", frozenset(self.reads))


@dataclass(frozen=True)
class Ends:
    """The value at both ends of what the paper allows a calibrated field."""

    field: str
    low: Value | Statement
    high: Value | Statement


@dataclass(frozen=True)
class Arithmetic:
    """The paper's own prints decide: ``holds`` says how."""

    from_: tuple[str, ...]
    holds: bool
    note: str = ""


@dataclass(frozen=True)
class Open:
    """A test lacks something; ``question`` asks for it."""

    question: str
    note: str = ""


@dataclass(frozen=True)
class Question:
    """What would settle a claim that has its verdict already."""

    question: str


@dataclass(frozen=True)
class Set:
    """The claim set a field of the twin, so it is no evidence."""

    field: str


@dataclass(frozen=True)
class Conflict:
    """Prints that cannot hold together; the set is the finding, not a culprit in it."""

    name: str
    inequality: str
    slack: float
    unit: str = ""


@dataclass(frozen=True)
class Block:
    """All cells of a table or figure in one chi-square; ``fitted`` parameters were fitted to
    them.
    """

    name: str
    reading: Mapping[str, str]
    chi2: float
    cells: int
    fitted: int = 0
    pulls: tuple[float, ...] = ()
    uses: tuple[str, ...] = ()
    note: str = ""

    @property
    def p_value(self) -> float:
        """Return the chance of a chi-square as large."""
        from scipy.special import chdtrc

        return float(chdtrc(self.cells - self.fitted, self.chi2))


Said: TypeAlias = Value | Statement | Ends | Arithmetic | Open | Question | Set | Conflict | Block
_KINDS: dict[str, type[Any]] = {
    kind.__name__: kind
    for kind in (Value, Statement, Ends, Arithmetic, Open, Question, Set, Conflict, Block)
}


@dataclass(frozen=True)
class Entry:
    """One thing said of one claim or several, by which cell of which notebook."""

    claims: tuple[str, ...]
    said: Said
    notebook: str = ""
    cell: str = field(default="")

    def as_record(self) -> dict[str, Any]:
        """Return what JSON can hold; `entry_from` reads it."""
        return {
            "claims": list(self.claims),
            "kind": type(self.said).__name__,
            "cell": self.cell,
            "said": _plain(self.said),
        }


def entry_from(record: Mapping[str, Any], notebook: str) -> Entry:
    """Return the entry that a record holds."""
    return Entry(
        tuple(record["claims"]), _said(record["kind"], record["said"]), notebook, record["cell"]
    )


def _plain(said: Said) -> dict[str, Any]:
    if isinstance(said, Ends):
        return {
            "field": said.field,
            **{
                end: {"kind": type(one).__name__, **_plain(one)}
                for end, one in (("low", said.low), ("high", said.high))
            },
        }
    plain = asdict(said)
    return {
        name: sorted(part)
        if isinstance(part, frozenset)
        else (part.item() if hasattr(part, "item") else part)
        for name, part in plain.items()
    }


def _said(kind: str, plain: Mapping[str, Any]) -> Said:
    if kind == "Ends":
        ends = {end: dict(plain[end]) for end in ("low", "high")}
        read: dict[str, Any] = {end: _said(one.pop("kind"), one) for end, one in ends.items()}
        return Ends(plain["field"], **read)
    tuples = {name: tuple(part) if isinstance(part, list) else part for name, part in plain.items()}
    made: Said = _KINDS[kind](**tuples)
    return made
