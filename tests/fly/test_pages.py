"""The pages on flights: they run as they are written, and print what they show; what they say of laws is so."""

import contextlib
import io
import re
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import marsedl.fly
from marsedl.fly import MARS, Entry, Lander, fly, laws
from marsedl.fly.vehicles import ENTRY_QUANTITIES, LANDER_QUANTITIES
from pictures import drawn_as_shown

PAGES = Path(__file__).parents[2] / "docs" / "examples"


def blocks(page):
    """Code of a page, block by block, and what the page shows below each of them, or None."""
    text = (PAGES / page).read_text(encoding="utf-8")
    return re.findall(r"(?ms)^```python\n(.*?)^```\n(?:```text\n(.*?)^```\n)?", text)


def printed(text):
    """What was printed, without blanks at the ends of lines, of which pages have none."""
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


def run(page, names):
    """Run a page's blocks one after the other; each prints what the page shows."""
    for code, shown in blocks(page):
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(code, page, "exec"), names)
        assert printed(out.getvalue()) == shown
    return names


@pytest.mark.filterwarnings("ignore:.*too hard", "ignore:.*out of propellant")
def test_own_equations_fly_as_their_page_shows():
    names = run("own_equations.md", {})
    np.testing.assert_allclose(names["flights"].final["velocity"], 480.0, atol=1e-9)
    # Its lander burns all of its propellant, and no more: the speed is that of the rocket equation.
    burn = {"altitude": 1500.0, "climb": -60.0, "mass": 900.0}
    emptied = fly(names["hopper"], burn, law=1.0, end_time=30.0, period=0.5, trials=2, compiled=False)
    np.testing.assert_allclose(emptied.final["mass"], 831.2, rtol=1e-14)
    np.testing.assert_allclose(emptied.final["climb"], 2157.0 * np.log(900 / 831.2) - 60.0 - 3.71 * 30.0, rtol=1e-9)
    assert emptied.outcomes() == {"out of propellant": 2}
    # With lift up on a planet that does not rotate, an entry stays in the plane, too.
    still = replace(names["capsule"], planet=MARS._replace(rotation_rate=0.0))
    options = {"law": 0.0, "end_time": 120.0, "trials": 1, "seed": 3, "compiled": False}
    own, entry = (
        fly(flies, names["start"], **options).final
        for flies in (still.with_equations(names["plane"], sense=names["feel"]), still)
    )
    for name in ("altitude", "velocity", "flight_path_angle", "range"):
        np.testing.assert_allclose(own[name], entry[name], rtol=1e-9)


def test_studies_show_what_their_page_shows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where it keeps a study
    with drawn_as_shown(tmp_path, "budget"):
        names = run("studies.md", {})
    # The next phase is a rocket in closed form, from where each trial ended.
    few, descent, time, exhaust = names["few"].final, names["descent"], 20.0, 220.0 * 9.80665
    flow, start = 4000.0 / exhaust, descent.drawn["start_mass"]
    mass = start - flow * time
    lifted = exhaust * (time - mass / flow * np.log(start / mass))
    fallen = few["altitude"] - descent.final["altitude"]
    np.testing.assert_allclose(fallen, 80.0 * time + 0.5 * 3.71 * time**2 - lifted, rtol=1e-6)


def test_a_law_flies_as_its_page_shows_also_in_processes(tmp_path):
    (_, (law, _), *others) = blocks("guidance_law.md")
    flights = 'print("----")\n'.join(code for code, _ in others).replace(
        '"trials": 1000', '"processes": 2, "trials": 1000'
    )
    script = tmp_path / "law.py"
    script.write_text(f"{law}\n\nif __name__ == '__main__':\n{textwrap.indent(flights, '    ')}", encoding="utf-8")
    process = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr[-2000:]
    assert [printed(text) for text in process.stdout.split("----\n")] == [shown for _, shown in others]


@pytest.mark.parametrize(
    ("vehicle", "quantities", "place"),
    [(Entry(115.0), ENTRY_QUANTITIES, 0), (Lander(1e4, 220.0), LANDER_QUANTITIES, 1)],
)
def test_the_page_tells_what_laws_are_told_and_command(vehicle, quantities, place):
    page = (PAGES / "guidance_law.md").read_text(encoding="utf-8")
    table = re.findall(r"(?m)(?:^\|.*\n)+", page)[place]
    rows = re.findall(r"(?m)^\| `(\w+)` \| (\S+) \| (.+) \|$", table)
    flight = vehicle.model().flight
    names = [*laws.told_by(flight)._fields, *laws.command_of(flight)._fields]
    assert rows == [(name, *quantities[name]) for name in names]


def test_a_positive_bank_turns_to_the_right_and_none_lifts():
    start = {"altitude_km": 40.0, "velocity": 4000.0, "flight_path_angle_deg": -5.0}
    options = {"end_time": 20.0, "trials": 1, "compiled": False}
    right, left, up = (fly(Entry(115.0, 0.24), start, law=bank, **options).final for bank in (1.2, -1.2, 0.0))
    assert right["crossrange"] > 100.0 > -100.0 > left["crossrange"]
    assert right["azimuth"] > np.pi / 2 > left["azimuth"]
    assert up["altitude"] > right["altitude"]
    assert up["flight_path_angle"] > right["flight_path_angle"]


def test_help_begins_with_an_example_and_names_all_that_there_is():
    names = {}
    text = marsedl.fly.__doc__
    example = textwrap.dedent("".join(re.findall(r"(?m)^    (?:start|flights).*\n", text)))
    exec(f"from marsedl.fly import *\n{example.replace('end_time', 'trials=2, compiled=False, end_time')}", names)
    assert names["flights"].trials == 2
    assert {name for name in marsedl.fly.__all__ if f"`{name}`" not in text} == set()
