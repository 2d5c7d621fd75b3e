"""A report as one page that asks for nothing from outside: text, tables and pictures under the four
questions of whoever was not there.

What a page is made of is text of HTML, escaped where it is made: `section`, `sentences`, `table`,
`Picture`. A chapter is a list of such sections; one that has nothing to say is an empty text.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from string import Template
from typing import TYPE_CHECKING, Literal

from losbench.made import Made

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "QUESTIONS",
    "Answer",
    "Doubt",
    "Picture",
    "most_telling",
    "page",
    "replies_to_dict",
    "section",
    "sentences",
    "table",
]

QUESTIONS = (
    "Did it work?",
    "May I believe it?",
    "What is the number?",
    "What would change it?",
    "How was it made?",
)
_NOTHING: tuple[object, ...] = (None, [], {})
_INK, _GRID = "#000000", "#e3e3e3"


class Doubt(str):
    """A note that speaks against the numbers that it stands beside."""

    __slots__ = ()


@dataclass(frozen=True)
class Answer:
    """A question's answer in a word or a number, and a sentence; ``state`` gives it its colour."""

    word: str
    text: str
    state: Literal["good", "care", "bad", "plain"] = "plain"


def page(
    title: str,
    subtitle: str,
    answers: Sequence[Answer],
    chapters: Mapping[str, Iterable[str]],
    *,
    made: Made,
    files: Iterable[str] = (),
) -> str:
    """Return a whole page.

    Parameters
    ----------
    title, subtitle : str
        Plain text.
    answers : sequence of Answer
        To the first of `QUESTIONS`, on top of the page.
    chapters : mapping of str to texts
        The sections of the first four; without any it is left out.
    made : Made
        For the last chapter.
    files : iterable of str
        Names of the files beside the page.

    Examples
    --------
    >>> text = page("a <b>", "", [Answer("yes", "")], {QUESTIONS[0]: ["", ""]}, made=Made())
    >>> "a &lt;b&gt;" in text, text.count("<h2")
    (True, 1)
    """
    chapters = {**chapters, QUESTIONS[-1]: _how_made(made, files)}
    told = {question: [each for each in parts if each] for question, parts in chapters.items()}
    asked = [
        f'<li class="{answer.state}"><a href="#{_id(question)}">{escape(question)}</a>'
        f"<strong>{escape(answer.word)}</strong><span>{escape(answer.text)}</span></li>"
        for question, answer in zip(QUESTIONS, answers, strict=False)
    ]
    body = [
        f'<h2 id="{_id(question)}">{escape(question)}</h2>\n' + "\n".join(parts)
        for question, parts in told.items()
        if parts
    ]
    template = Template(
        resources.files("losbench").joinpath("page.html").read_text(encoding="utf-8")
    )
    return template.substitute(
        title=escape(title),
        subtitle=escape(subtitle),
        answers="\n".join(asked),
        chapters="\n".join(body),
        foot=f"Made by losbench {escape(made.versions['losbench'])}. The page is whole in itself "
        "and asks for nothing from outside.",
    )


def replies_to_dict(replies: Sequence[Answer]) -> list[dict[str, str]]:
    """Return answers as report.json has them."""
    return [
        {"question": question, "answer": reply.word, "state": reply.state, "said": reply.text}
        for question, reply in zip(QUESTIONS, replies, strict=False)
    ]


def most_telling(doubts: Sequence[str]) -> str:
    """Return the first two doubts, and how many more there are.

    >>> most_telling(["One.", "Two.", "Three."])
    'One. Two. And 1 more, below.'
    """
    more = len(doubts) - 2
    return " ".join([*doubts[:2], *[f"And {more} more, below."] * (more > 0)])


def section(title: str, *parts: str) -> str:
    """Return parts under a heading; nothing where all are empty.

    >>> print(section("Spots", sentences(["2 < 3"])), section("Shifts", ""))
    <section>
    <h3>Spots</h3>
    <p>2 &lt; 3</p>
    </section>
    """
    told = "\n".join(part for part in parts if part)
    return f"<section>\n<h3>{escape(title)}</h3>\n{told}\n</section>" if told else ""


def sentences(lines: Iterable[str]) -> str:
    """Return one line as a paragraph, several as a list."""
    lines = list(lines)
    if len(lines) < 2:
        return "".join(f"<p>{escape(line)}</p>" for line in lines)
    return "<ul>\n" + "\n".join(f"<li>{escape(line)}</li>" for line in lines) + "\n</ul>"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]], *, caption: str) -> str:
    """Return a table whose first column names its rows; columns of numbers stand to the right.

    >>> print(table(["axis", "rms (arcsec)"], [["X", 0.25]], caption="Angles"))
    <div class="wide"><table><caption>Angles</caption>
    <thead><tr><th scope="col">axis</th><th scope="col" class="number">rms...</thead>
    <tbody>
    <tr><th scope="row">X</th><td class="number">0.25</td></tr>
    </tbody></table></div>
    """
    rows = [list(row) for row in rows]
    if not rows:
        return ""
    to_the_right = [
        all(re.fullmatch(r"[-+.\deE]*", _cell(row[k])) for row in rows) for k in range(len(heads))
    ]
    style = [' class="number"' * right for right in to_the_right]
    named = "".join(
        f'<th scope="col"{how}>{escape(head)}</th>' for head, how in zip(heads, style, strict=True)
    )
    body = "\n".join(
        f'<tr><th scope="row"{style[0]}>{_cell(row[0])}</th>'
        + "".join(f"<td{how}>{_cell(v)}</td>" for v, how in zip(row[1:], style[1:], strict=True))
        + "</tr>"
        for row in rows
    )
    return (
        f'<div class="wide"><table><caption>{escape(caption)}</caption>\n'
        f"<thead><tr>{named}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>"
    )


@dataclass(frozen=True)
class Picture:
    """A figure with its title; ``said`` is what one who cannot see it would need to know."""

    title: str
    said: str
    figure: Figure

    def png(self) -> bytes:
        """Return it as a file of its own, its title on it."""
        from losbench.figures import png

        self.figure.suptitle(self.title, parse_math=False)  # a sensor may be called T_$1$
        return png(self.figure)

    def html(self) -> str:
        """Return it as a part of a page, whose ink its black and its grid take."""
        import matplotlib as mpl

        name, buffer = _id(self.title), io.StringIO()
        self.figure.suptitle("")
        with mpl.rc_context({"svg.hashsalt": name, "svg.fonttype": "path", "savefig.dpi": 150}):
            self.figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
        text = buffer.getvalue()
        drawn = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
        drawn = drawn.strip().replace(_INK, "currentColor").replace(_GRID, "var(--grid)")
        # Names within a drawing would be names within the whole page.
        drawn = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", drawn)
        spoken = f'<svg role="img" aria-label="{escape(f"{self.title}. {self.said}")}"'
        return (
            f"<figure><figcaption><b>{escape(self.title)}</b>"
            f"<span>{escape(self.said)}</span></figcaption>\n"
            f"{drawn.replace('<svg', spoken, 1)}</figure>"
        )


def _how_made(made: Made, files: Iterable[str]) -> list[str]:
    """Return the sections of the last chapter: command, settings, inputs, versions, files."""
    inputs = [
        [
            each.name,
            each.n_files,
            each.size_bytes,
            each.modified_utc,
            each.sha256 or f"of the first and the last MB: {each.sha256_of_ends}",
        ]
        for each in made.inputs
    ]
    heads = ["name", "files", "bytes", "changed (UTC)", "sha256"]
    several = "Of several files, sha256 is that of what sha256sum prints of them, by name."
    return [
        section(
            "Command", f"<pre>{escape(made.command)}</pre>" if made.command else "", _when(made)
        ),
        section(
            "What was read",
            table(heads, inputs, caption="Inputs"),
            sentences([several] * any(each.n_files > 1 for each in made.inputs)),
        ),
        section(
            "Settings",
            table(["setting", "value"], _given(made), caption="As given, or by default"),
            _left_out(made),
        ),
        section(
            "Versions",
            table(["package", "version"], made.versions.items(), caption="Of what computed it"),
        ),
        section("Files beside this page", sentences(files)),
    ]


def _when(made: Made) -> str:
    return sentences([f"Run at {made.when_utc}."])


def _given(made: Made) -> list[list[str]]:
    return [
        [name, ", ".join(map(_said, value if isinstance(value, list) else [value]))]
        for name, value in sorted(made.settings.items())
        if value not in _NOTHING
    ]


def _said(value: object) -> str:
    return ("no", "yes")[value] if isinstance(value, bool) else str(value)


def _left_out(made: Made) -> str:
    names = sorted(name for name, value in made.settings.items() if value in _NOTHING)
    return sentences([f"Not given: {', '.join(names)}."] * bool(names))


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.4g}"
    # A sum or a path may break where it must: it would make its table wider than a sheet.
    return re.sub(r"([^\s&;]{16})(?=[^\s&;]{16})", r"\1<wbr>", escape(str(value)))


def _id(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
