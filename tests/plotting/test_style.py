"""Figures are the same bytes whenever they are drawn from the same numbers."""

import time

import matplotlib as mpl
import pytest

from marsedl.plotting.style import new_figure, save_figure


def example_figure(slope=1.0):
    figure, axes = new_figure(2.0, 1.5)
    axes.plot([0, 1], [0, slope], label=r"$\sigma$")
    axes.legend()
    return figure


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_the_same_figure_is_the_same_bytes_at_another_time(tmp_path, monkeypatch, ending):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    first, second, other = (tmp_path / f"{name}.{ending}" for name in ("first", "second", "other"))
    save_figure(example_figure(), first)
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + 86_400)
    save_figure(example_figure(), second)
    save_figure(example_figure(2.0), other)
    assert first.read_bytes() == second.read_bytes()
    assert first.read_bytes() != other.read_bytes()


@pytest.mark.parametrize("ending", ["png", "pdf"])
def test_a_matplotlibrc_of_the_user_changes_no_byte(tmp_path, ending):
    settings = tmp_path / "matplotlibrc"
    settings.write_text("font.family: serif\naxes.facecolor: lightyellow\ntext.usetex: True\nlines.linestyle: --\n")
    paths = [tmp_path / f"{name}.{ending}" for name in ("plain", "with")]
    save_figure(example_figure(), paths[0])
    with mpl.rc_context(fname=settings):
        save_figure(example_figure(), paths[1])
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_both_files_of_a_figure_are_written_into_new_folders(tmp_path):
    paths = [tmp_path / "new" / f"fig01.{ending}" for ending in ("png", "pdf")]
    save_figure(example_figure(), *map(str, paths))
    assert paths[0].read_bytes().startswith(b"\x89PNG")
    assert paths[1].read_bytes().startswith(b"%PDF")
    assert b"CreationDate" not in paths[1].read_bytes()


def test_panels_get_letters_once_and_what_is_no_panel_gets_none(tmp_path):
    figure, ((first, second), (third, hidden)) = new_figure(4.0, 3.0, nrows=2, ncols=2)
    first.set_title("range")
    third.twinx()
    hidden.axis("off")
    figure.colorbar(mpl.cm.ScalarMappable(), ax=second)
    save_figure(figure, tmp_path / "once.png")
    save_figure(figure, tmp_path / "twice.png")
    titles = [axes.get_title() or axes.get_title("left") for axes in figure.axes]
    assert [title for title in titles if title] == ["(a) range", "(b)", "(c)"]
    alone = example_figure()
    save_figure(alone, tmp_path / "one.png")
    assert not any(alone.axes[0].get_title(side) for side in ("left", "center"))
