"""One term for one thing: the glossary has each term once, and other terms are not used."""

import re
from pathlib import Path

import pytest
from shown import CHECKOUT, DOCS, PAGES, page

import trisquare as ts

GLOSSARY = page("glossary.md")
USED, NOT_USED = GLOSSARY.split("## Terms that are not used")
# Pages with other programs' own terms, and with texts of benchmarks.
OTHERS_TERMS = ("glossary.md", "migration.md", "measured.md")


def prose():
    """Yield the pages, the README, and the sources of the package and the crate."""
    yield from (DOCS / name for name in PAGES if name not in OTHERS_TERMS)
    yield from (DOCS / "api").glob("*.rst")
    yield CHECKOUT / "README.md"
    package = Path(ts.__file__).parent
    yield from (path for path in package.glob("**/*.py") if "formats" not in path.parts)
    yield from (CHECKOUT / "rust" / "trisquare" / "src").glob("**/*.rs")


@pytest.mark.parametrize("term", re.findall(r"^\| ([a-z][a-z ]+) \|", NOT_USED, re.M)[1:])
def test_a_term_that_is_not_used_is_not_used(term):
    said = re.compile(rf"\b{term}s?\b", re.IGNORECASE)
    found = [path.name for path in prose() if said.search(path.read_text("utf-8"))]
    assert not found


def test_no_term_stands_twice():
    rows = re.findall(r"^\| ([^|]+) \| ", USED, re.MULTILINE)
    terms = [term for term in rows if term not in ("term", "---")]
    assert len(terms) > 40
    assert len(set(terms)) == len(terms)
