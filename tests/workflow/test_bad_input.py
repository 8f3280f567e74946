"""Bad input ends in one message before any job, and nothing is built.

What is refused, and with which words, is tested without Snakemake, whose starts take seconds: here by the facts of each
paper, else beside `replication/inputs` and `replication/pipeline/targets.py`. A few starts show that both are asked.
"""

import re
from pathlib import Path

import pytest
import yaml

from marsedl.papers import SLUGS, input_model
from marsedl.replication.errors import InputError
from marsedl.replication.inputs.readings import load_studies

pytestmark = pytest.mark.workflow

ROOT = Path(__file__).parents[2]
MODELS = {slug: input_model(slug) for slug in SLUGS}
FACTS = {
    slug: yaml.safe_load((Path(__file__).parent / "facts" / f"{slug}.yaml").read_text(encoding="utf-8"))
    for slug in SLUGS
}
TARGET = "figures/powered_descent/mine/fig07.png"


@pytest.mark.parametrize(
    ("slug", "inputs", "fragments"),
    [(slug, case["inputs"], case["said"]) for slug in SLUGS for case in FACTS[slug]["refused"]],
)
def test_malformed_inputs_of_a_reading_of_the_user_are_refused(tmp_path, slug, inputs, fragments):
    path = tmp_path / "mine.yaml"
    reading = f"{{mine: {{based_on: corrected, {inputs}}}}}"
    path.write_text(f"{slug}: {{readings: {reading}}}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_studies(MODELS, ROOT, config_files=[path])
    for fragment in ("mine.yaml", *fragments):
        assert fragment in str(caught.value)


@pytest.mark.parametrize("slug", SLUGS)
def test_a_changed_frozen_reading_is_refused(tmp_path, slug):
    text = (ROOT / "configs" / f"{slug}.yaml").read_text(encoding="utf-8")
    first_number = re.compile(r"(?ms)(^  printed:\n.*?\{value: )(\d+\.[\de+-]+)")
    edited, number = first_number.subn(lambda match: f"{match[1]}{1.001 * float(match[2])}", text, count=1)
    assert number == 1
    (tmp_path / "configs").mkdir()
    (tmp_path / "data").symlink_to(ROOT / "data")
    (tmp_path / "configs" / f"{slug}.yaml").write_text(edited, encoding="utf-8")
    with pytest.raises(InputError, match=rf"{slug}.yaml:\d+: readings.printed: is frozen.*based_on: printed"):
        load_studies({slug: MODELS[slug]}, tmp_path)


def refused(tree, *arguments, configfile=None) -> str:
    """Run Snakemake, which must end with one message of ours, no traceback and nothing built; returns the message."""
    before, said = tree.state(), tree.fails(*arguments, configfile=configfile)
    assert "Job stats" not in said
    assert tree.state() == before
    (message,) = [line for line in said.splitlines() if line.startswith("marsedl: ")]
    return message


def test_what_is_wrong_in_a_users_file_is_the_last_word(copied, tmp_path):
    path = tmp_path / "mine.yaml"
    body = "{based_on: corrected, planet: {gravty: {value: 3.7, source: Eq. 1}}}"
    path.write_text(f"powered_descent: {{readings: {{mine: {body}}}}}\n", encoding="utf-8")
    message = refused(copied, TARGET, configfile=path)
    where = f"{path}:1: powered_descent.readings.mine.planet.gravty"
    assert message == f"marsedl: {where}: unknown key; did you mean 'gravity'?"


def test_a_target_that_nothing_makes_is_refused(copied):
    message = refused(copied, "figures/powered_descent/fig7.png")
    assert message.endswith("; did you mean 'figures/powered_descent/fig07.png'?")
