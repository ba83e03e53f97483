"""List every text that people can see, with its place, in out/texts.md.

Without arguments the list is complete; ``--sample 200 --seed 1`` draws 200 texts at random.
"""

import argparse
import ast
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUTPUT = ROOT / "out" / "texts.md"
AREAS = (
    "web/templates/**/*.html",
    "web/static/js/**/*.js",
    "words/**/*.py",
    "server/pages/**/*.py",
    "server/**/*.py",
    "cli/**/*.py",
    "planner/**/*.py",
    "client/**/*.py",
    "web/**/*.py",
    "*.md",
    "docs/*.md",
)
"""Files with texts, in the order of the list; a file is listed under the first match."""

SEEN_ATTRIBUTES = ("title", "alt", "placeholder", "aria-label", "content", "data-hint", "label")
"""Attributes of HTML that browsers show or read aloud."""

JS_TOKEN = re.compile(
    r"//[^\n]*|/\*.*?\*/"
    r"|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'"
    r"|`(?:\\.|\$\{(?:[^{}`]|`[^`]*`|\{[^{}]*\})*\}|[^`\\])*`",
    re.DOTALL,
)
"""Comments, strings and templates of a script; quotes inside a matched comment are skipped."""

JS_CONCATENATION = re.compile(r"(?<=[^\\])([\"'`])\s*\+\s*\1")
JS_INSERTION = re.compile(r"\$\{((?:[^{}`]|`[^`]*`|\{[^{}]*\})*)\}", re.DOTALL)
JINJA = re.compile(r"\{#.*?#\}|\{%.*?%\}|\{\{.*?\}\}", re.DOTALL)
QUOTED = re.compile(r"\"([^\"]*)\"|'([^']*)'")
MARKDOWN_CODE = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
MARKDOWN_START = re.compile(r"\s*([#|<>]|[-*] |\d+\. )")
"""Beginning of a line that continues no paragraph."""

SENTENCE_END = re.compile(r"(?<=[.!?]) +(?=[A-Z*`\[(])")
SENTENCE = re.compile(r"[A-Za-z]{2,}[,;:]? +[(\"]?[a-z0-9{…]|^[A-Z][a-z]+( [a-z]+)*[.:?!…]?$")
"""Two words in a row, or one capitalised word: a text for people, not a key or a path."""

CODE = re.compile(
    r"^(SELECT|UPDATE|INSERT|DELETE|CREATE|ALTER|PRAGMA|VACUUM)\b|[{;]\s*$|^[a-z-]+(/[a-z-]+)+$"
    r"|^\(prefers-|^\(max-width|^(button|hint|swatch|choice-dot) [a-z]+$|sandbox;|max-age="
    r"|\bno-(cache|store)\b|^[a-z]+(-[a-z]+)+( [a-z]+(-[a-z]+)+)+$|\bu?int\d+ [a-z]|^MSG: "
)
"""Matches SQL statements, lists of CSS classes, headers of HTTP, definitions of messages and other
code that is not shown to people."""

MARKUP = re.compile(r"^(?!.*\b(alt|title)=\"[^\"{])<[^<>]*>( ?<[^<>]*>)*$")
"""Matches elements of XML or HTML without a text, a title or an alternative text of their own."""


@dataclass(frozen=True, slots=True)
class Text:
    """One text and its place."""

    path: str
    line: int
    words: str


def is_for_people(words: str) -> bool:
    """Return True if a string reads as a text for people."""
    return bool(SENTENCE.search(words)) and not (CODE.search(words) or MARKUP.search(words))


def in_python(source: str) -> Iterator[tuple[int, str]]:
    """Find the string literals of a module, and the docstrings that commands and routes show."""
    tree = ast.parse(source)
    skipped = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            skipped.update(id(part) for part in node.values)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.decorator_list:
            called = any(
                isinstance(decorator, ast.Call) and isinstance(decorator.func, ast.Attribute)
                for decorator in node.decorator_list
            )
            if called and (docstring := ast.get_docstring(node)):
                yield node.lineno, docstring
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(_joined(part) for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def _joined(part: ast.expr) -> str:
    """Return a literal part of an f-string, or an inserted value as {…}."""
    return part.value if isinstance(part, ast.Constant) and isinstance(part.value, str) else "{…}"


class _Nodes(HTMLParser):
    """Collector of the text nodes and shown attributes of a template without its Jinja."""

    def __init__(self) -> None:
        """Start without texts."""
        super().__init__()
        self.texts: list[tuple[int, str]] = []
        self._silent = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect the shown attributes."""
        self._silent = tag in ("script", "style")
        for name, value in attrs:
            if name in SEEN_ATTRIBUTES and value:
                self.texts.append((self.getpos()[0], value))

    def handle_endtag(self, tag: str) -> None:
        """Leave a script or a style."""
        self._silent = False

    def handle_data(self, data: str) -> None:
        """Collect a text node."""
        if data.strip() and not self._silent:
            self.texts.append((self.getpos()[0], data))


def in_html(source: str) -> Iterator[tuple[int, str]]:
    """Find the text nodes and shown attributes of a template, and the strings in its Jinja."""
    for block in JINJA.finditer(source):
        for quoted in QUOTED.finditer(block[0]):
            yield (
                source.count("\n", 0, block.start() + quoted.start()) + 1,
                quoted[1] or quoted[2] or "",
            )
    nodes = _Nodes()
    nodes.feed(
        JINJA.sub(
            lambda block: (
                ("{…}" if block[0].startswith("{{") else "") + "\n" * block[0].count("\n")
            ),
            source,
        )
    )
    yield from nodes.texts


def in_script(source: str) -> Iterator[tuple[int, str]]:
    """Find the string literals and templates of a script, with literals joined by + as one."""
    joined = JS_CONCATENATION.sub(lambda join: "\0" * join[0].count("\n"), source)
    for token in JS_TOKEN.finditer(joined):
        if token[0].startswith(("//", "/*")):
            continue
        line = sum(map(joined[: token.start()].count, "\n\0")) + 1
        words = token[0][1:-1].replace("\0", "")
        if token[0].startswith("`"):
            for inserted in JS_INSERTION.finditer(words):
                yield from ((line, inner) for _, inner in in_script(inserted[1]))
            words = JS_INSERTION.sub("{…}", words)
        yield line, words.replace('\\"', '"').replace("\\'", "'")


def in_markdown(source: str) -> Iterator[tuple[int, str]]:
    """Find the sentences of a document outside of its code blocks; a row of a table is one text."""
    lines = MARKDOWN_CODE.sub(lambda block: "\n" * block[0].count("\n"), source).split("\n")
    paragraphs: list[tuple[int, str]] = []
    open_paragraph = False
    for number, line in enumerate(lines, start=1):
        if open_paragraph and line.strip() and not MARKDOWN_START.match(line):
            first, words = paragraphs[-1]
            paragraphs[-1] = first, f"{words} {line.strip()}"
        elif line.strip():
            paragraphs.append((number, line.strip()))
        open_paragraph = bool(line.strip()) and not line.startswith(("#", "|", "<"))
    for number, words in paragraphs:
        is_row = words.startswith("|")
        yield from ((number, text) for text in ([words] if is_row else SENTENCE_END.split(words)))


READERS = {".py": in_python, ".html": in_html, ".js": in_script, ".md": in_markdown}


def all_texts(root: Path = ROOT) -> list[Text]:
    """Collect every text of the repository, in the order of AREAS."""
    paths = dict.fromkeys(path for area in AREAS for path in sorted(root.glob(area)))
    texts = (
        Text(str(path.relative_to(root)), line, " ".join(words.split()))
        for path in paths
        for line, words in sorted(READERS[path.suffix](path.read_text(encoding="utf-8")))
    )
    return [text for text in texts if is_for_people(text.words)]


def main() -> None:
    """Write the list, or a sample of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--sample", type=int, help="number of texts drawn at random (default: all)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    arguments = parser.parse_args()
    texts = all_texts()
    if arguments.sample:
        texts = random.Random(arguments.seed).sample(texts, min(arguments.sample, len(texts)))
    OUTPUT.parent.mkdir(exist_ok=True)
    OUTPUT.write_text(
        "".join(f"- `{text.path}:{text.line}` {text.words}\n" for text in texts), encoding="utf-8"
    )
    print(f"{OUTPUT.relative_to(ROOT)}: {len(texts)} texts")


if __name__ == "__main__":
    main()
