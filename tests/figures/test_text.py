"""A user's own text is drawn as it is, whatever TeX would make of it."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import pytest
from matplotlib.mathtext import MathTextParser

from pipelines.figures import style
from pipelines.figures.machine_drawing import draw_machine

TEXTS = [
    "costs 5 $",
    "$ 3 to 5 $ each",
    r"\$ and \alpha $x_1^2$",
    "50 % & more # {a} ~ ^ _ \\",
    "$",
    "$$",
    "$\\frac{",
    "_begins with an underscore",
    "_$_",
]


def drawn(text: str) -> str:
    """The letters that matplotlib draws for a text, formulas parsed; without spaces, which have no glyph."""
    _, _, _, glyphs, _ = MathTextParser("path").parse(text)
    return "".join(chr(glyph[2]) for glyph in glyphs)


@pytest.mark.parametrize("text", TEXTS)
def test_text_is_drawn_as_it_is(text: str) -> None:
    assert drawn(style.literal(text)).replace(" ", "") == text.replace(" ", "")
    assert not style.literal(text).startswith("_")


@pytest.mark.parametrize("text", TEXTS)
def test_notes_and_materials_of_any_text(view, text: str, tmp_path) -> None:
    named = replace(view.machine, attributes={"material_names": [text, "titanium"]})
    figure = draw_machine(replace(view, note=text, machine=named))
    (note,) = (each.get_text() for each in figure.artists if hasattr(each, "get_text"))
    labels = [each.get_text() for each in figure.legends[0].get_texts()]
    assert note == style.literal(text)
    assert style.literal(text) in labels
    for kind in style.FORMATS:
        assert style.save_figure(figure, tmp_path / f"a.{kind}").stat().st_size > 0


def test_letters_that_the_font_lacks_are_no_warning(view, recwarn, tmp_path) -> None:
    figure = draw_machine(replace(view, note="\u6f22\u5b57 \U0001f300"))
    for kind in style.FORMATS:
        assert style.save_figure(figure, tmp_path / f"a.{kind}").stat().st_size > 0
    assert not recwarn.list


def test_control_characters_leave_a_readable_file(view, tmp_path) -> None:
    text = "a\x00b\x07\x1b[31m \x85\uffff -- c"
    named = replace(view.machine, attributes={"material_names": [text, "titanium"]})
    path = style.save_figure(draw_machine(replace(view, note=text, machine=named)), tmp_path / "a.svg")
    assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_a_long_title_is_broken_into_lines() -> None:
    title = f"{'x' * 200}: Campbell diagram"
    with style.styled():
        figure = style.finish(style.new_figure(2.0), title)
    assert max(map(len, figure.get_suptitle().splitlines())) <= style.TITLE_WIDTH
    box, width = figure._suptitle.get_window_extent(), figure.bbox.width
    assert box.x0 >= 0.0
    assert box.x1 <= width
