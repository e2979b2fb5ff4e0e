"""Line numbers of keys."""

from __future__ import annotations

import tomllib

from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.case.locating import key_lines

TEXT = (
    '''\
# comment with [brackets] = and "quotes
a = 1 # x = 2
"q.k" = "s # no"
[t]
m = """
x = 3
""\\" [y]
"""
arr = [
  1, # one ]
  [2, 3],
]
d.e = {f = 1, g = [ {h = 2}, {h = 3} ]}

[[b]]
n = '''
    + """'''
[b]
'''"""
    + """
[b.foil]
s = 'x\\'
[[b]]
"n\\u0041" = 2
foil = { s = 3 }
[c.d]
[c]
"""
)


def test_every_kind_of_key_is_found_at_its_line():
    assert key_lines(TEXT) == {
        ("a",): 2,
        ("q.k",): 3,
        ("t",): 4,
        ("t", "m"): 5,
        ("t", "arr"): 9,
        ("t", "arr", 0): 10,
        ("t", "arr", 1): 11,
        ("t", "arr", 1, 0): 11,
        ("t", "arr", 1, 1): 11,
        ("t", "d"): 13,
        ("t", "d", "e"): 13,
        ("t", "d", "e", "f"): 13,
        ("t", "d", "e", "g"): 13,
        ("t", "d", "e", "g", 0): 13,
        ("t", "d", "e", "g", 0, "h"): 13,
        ("t", "d", "e", "g", 1): 13,
        ("t", "d", "e", "g", 1, "h"): 13,
        ("b",): 15,
        ("b", 0): 15,
        ("b", 0, "n"): 16,
        ("b", 0, "foil"): 19,
        ("b", 0, "foil", "s"): 20,
        ("b", 1): 21,
        ("b", 1, "nA"): 22,
        ("b", 1, "foil"): 23,
        ("b", 1, "foil", "s"): 23,
        ("c",): 25,
        ("c", "d"): 24,
    }


def paths(node, path=()):
    """The path of every table, array item and value of a parsed document."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from paths(value, (*path, key))


def test_exactly_the_keys_of_the_document_are_found():
    assert set(key_lines(TEXT)) == set(paths(tomllib.loads(TEXT)))


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet=st.sampled_from("ab.=[]{}\"'#,\\\n\r\t 01é\0"), max_size=60) | st.text(max_size=40))
def test_no_text_makes_it_raise_and_toml_is_located_completely(text):
    lines = key_lines(text)
    assert all(1 <= line <= text.count("\n") + 1 for line in lines.values())
    try:
        document = tomllib.loads(text)
    except ValueError:
        return
    assert set(lines) == set(paths(document))


def test_deep_nesting_and_unclosed_strings_stop_it():
    assert key_lines("a = " + "[" * 100_000)[("a",)] == 1
    assert key_lines('a = 1\nb = """ never closed')[("b",)] == 2
