"""The benchmark "which effect is missing": its data are made again as they are, the scorer counts what it says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import CATALOGUE
from tests.support.commands import stdout_of
from validation.missing_effect import make_data
from validation.missing_effect.answers import ANSWERS
from validation.missing_effect.score import DATA, EFFECTS, PLACES, Score, main, read_answers, read_truth, score, scores
from validation.proofs.result_file import FOLDER, read

NAMES = st.sampled_from(["backlash@joint1", "drift@joint2", "coupling@joint3<-joint2", "mass@link5"])
MOST_BYTES = 60_000


@pytest.mark.long
def test_the_data_are_made_again_as_they_are(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(make_data, "FOLDER", tmp_path)
    monkeypatch.setattr(make_data, "TRUTH", tmp_path / "truth.json")
    make_data.main()
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in DATA.iterdir() if not path.name.startswith("."))
    for name in made:
        assert (tmp_path / name).read_text("utf-8") == (DATA / name).read_text("utf-8"), name


@pytest.mark.long
@pytest.mark.parametrize("name", make_data.SETS)
def test_a_data_set_is_small_and_complete(name: str) -> None:
    assert (DATA / f"{name}.csv").stat().st_size < MOST_BYTES
    assert stdout_of("dataset", "check", DATA / f"{name}.csv").startswith("Complete")


def test_the_metadata_say_nothing_of_the_truth() -> None:
    for name in make_data.SETS:
        text = (DATA / f"{name}.toml").read_text("utf-8")
        assert not [effect for effect in EFFECTS if effect in text]


def test_the_scorer_knows_every_effect_of_the_catalogue_and_its_places() -> None:
    """But offsets and compliance, which every fit has."""
    arm = load_arm("lrm-lab")
    assert sorted(EFFECTS) == sorted(kind.id for kind in CATALOGUE if kind.id not in ("offsets", "compliance"))
    places = {place.partition("<-")[0] for kind in CATALOGUE for place in kind.places(arm) if kind.id in EFFECTS}
    assert places <= {*PLACES}


@given(st.lists(NAMES, unique=True), st.lists(NAMES, unique=True))
def test_every_true_effect_and_every_answer_counts_once(truth: list[str], answers: list[str]) -> None:
    found = score([[one] for one in answers], [[one] for one in truth])
    both = len({*truth} & {*answers})
    assert found == Score(both, len(truth) - both, len(answers) - both)


def test_a_class_is_right_if_one_of_it_is() -> None:
    truth = [["drift@joint2"], ["coupling@joint3<-joint2"]]
    assert score([["mass@link5", "drift@joint2"]], truth) == Score(1, 1, 0)
    assert score([["drift@joint2"], ["drift@joint2"]], truth) == Score(1, 1, 1)


def test_the_committed_scores_are_those_of_the_committed_answers() -> None:
    truth, rows = read_truth(), read(FOLDER / "benchmark.json").rows
    for by in ("lrm-ident auto", "largest coefficient", "best correlation"):
        found = scores(read_answers(ANSWERS / f"{by.replace(' ', '-')}.json", truth), truth)
        counts = {row[0]: Score(*row[4:]) for row in rows if row[2] == by}  # type: ignore[arg-type]
        assert counts == found


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is no JSON"),
        ("[]", "should have a list of names for each of play, two, nothing"),
        ('{"play": [], "two": []}', "should have a list of names for each of play, two, nothing"),
        ('{"play": 1, "two": [], "nothing": []}', "play should be a list of names"),
        ('{"play": ["backlash"], "two": [], "nothing": []}', "should be effect@place"),
        ('{"play": ["banana@joint1"], "two": [], "nothing": []}', "should be effect@place"),
        ('{"play": [[]], "two": [], "nothing": []}', "is no name"),
    ],
)
def test_wrong_answers_are_one_line(text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "answers.json"
    path.write_text(text, encoding="utf-8")
    assert main([str(path)]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1


def test_a_competitor_sees_counts_per_data_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "answers.json"
    path.write_text(json.dumps({"play": [["backlash@joint3"]], "two": ["mass@link5"], "nothing": []}), encoding="utf-8")
    assert main([str(path)]) == 0
    assert [line.split() for line in capsys.readouterr().out.splitlines()[1:]] == [
        ["play", "1", "0", "0"],
        ["two", "0", "2", "1"],
        ["nothing", "0", "0", "0"],
        ["all", "1", "2", "1"],
    ]
    assert main(["--names"]) == 0
    assert "coupling" in capsys.readouterr().out
