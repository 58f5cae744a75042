"""`lrm-ident fleet`: manifest, resuming, broken arms, the cluster, and the prior it makes."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.fitting.executors import executor_for, in_this_process
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.priors import EffectRates, PriorFile, load_prior, load_rates
from lrm_ident.fleet import run_fleet as running
from lrm_ident.fleet.identify_arm import ArmRecord, identify_arm
from lrm_ident.fleet.manifest import read_manifest
from lrm_ident.fleet.run_fleet import run_fleet, task_of
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError
from lrm_math.model.model_file import ModelFile
from lrm_math.model.step_name import REFIT, StepName
from lrm_math.toml_file import read_toml
from tests.ident.fleet.conftest import ARM, ARMS, ODD, SOFT
from tests.support.browser import BrowserLog, axe_violations, chromium, settle, shot, with_axe
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import soak

pytestmark = pytest.mark.usefixtures("one_step_folds")


@pytest.mark.long
def test_manifest_and_its_faults(tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    path.write_text("Data;Batch\na.csv;A\nb.csv;B\n")
    first, second = read_manifest(path)
    assert (first.name, first.data, first.arm, first.tags) == ("a", tmp_path / "a.csv", "", (("Batch", "A"),))
    assert second.name == "b"
    for text, what in [
        ("batch\nA\n", "missing column data"),
        ("data\na.csv\na.csv\n", "two arms are called a"),
        ("data,name\na.csv,../x\n", "line 2, column name: '../x' names no file"),
        ("data,name\n,x\n", "line 2, column data: the cell is empty"),
    ]:
        path.write_text(text)
        with pytest.raises(FileError, match=what):
            read_manifest(path)
    assert "no such file" in stderr_of("fleet", tmp_path / "none.csv", "-o", tmp_path / "out")


@pytest.fixture(scope="module")
def identified(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder that the command writes, and what it prints; in this process: no seconds of starting others."""
    out = tmp_path_factory.mktemp("identified") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lrm_ident.cli.groups.fleet.executor_for", lambda *_, **__: in_this_process())
        return out, stdout_of("fleet", manifest, "-o", out, "--json", out.with_name("fleet.json"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A headless Chromium."""
    with chromium() as found:
        yield found


@pytest.mark.slow
def test_the_page_in_a_browser(browser: Any, identified: tuple[Path, str]) -> None:
    """Every figure is drawn; a click on an arm marks it, and another parameter shows who stands out."""
    seen = BrowserLog()
    with browser.new_page() as page:
        seen.listen(page)
        page.goto((identified[0] / "fleet.html").as_uri())
        for figure in ("errors", "parameter"):
            page.wait_for_selector(f"#lrm-{figure} .main-svg", state="attached")
        assert "No arm has an effect" in page.inner_text("#lrm-effects")
        assert "beside each name" not in page.inner_text("main"), "words on a figure that is not there"
        assert page.input_value("#lrm-key") == SOFT
        assert page.text_content("#lrm-parameter .annotation") == f"arm{ODD}"
        page.evaluate(f"lrmFleet.mark({ODD})")
        assert f"arm{ODD}" in page.inner_text("#lrm-marked")
        page.select_option("#lrm-tag", "batch")
        page.select_option("#lrm-key", "offsets.joint1.theta_rad")
        assert "theta" in (page.text_content("#lrm-parameter .ytitle") or "")
        shot(page, "fleet.png", full_page=True)
    assert not seen.errors, seen.errors
    assert not seen.foreign("file:")


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["dark", *soak("light")])
def test_the_page_fits_every_screen(browser: Any, identified: tuple[Path, str], scheme: str) -> None:
    with browser.new_page(color_scheme=scheme) as page:
        for width in (390, 800, 1440):
            page.set_viewport_size({"width": width, "height": 900})
            page.goto((identified[0] / "fleet.html").as_uri())
            page.wait_for_selector("#lrm-parameter .main-svg", state="attached")
            assert page.evaluate("document.documentElement.dataset.theme") == scheme
            settle(page, 500)
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), width
            if width == 390:
                top = "document.querySelector('header {}').getBoundingClientRect().top"
                verdict, controls = (page.evaluate(top.format(one)) for one in (".verdict", ".lrm-controls"))
                assert verdict < controls, "what was found, before what can be chosen"
            mark = page.evaluate("document.querySelector('#lrm-parameter .annotation').getBoundingClientRect().right")
            assert mark <= page.evaluate("document.getElementById('lrm-parameter').getBoundingClientRect().right")
            shot(page, f"fleet-{scheme}-{width}.png", full_page=True)


@with_axe
@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_on_the_page(browser: Any, identified: tuple[Path, str], scheme: str) -> None:
    with browser.new_page(color_scheme=scheme) as page:
        page.goto((identified[0] / "fleet.html").as_uri())
        page.wait_for_selector("#lrm-parameter .main-svg", state="attached")
        assert axe_violations(page) == []


@pytest.mark.slow
def test_on_paper_no_legend_lies_over_a_chart(browser: Any, identified: tuple[Path, str]) -> None:
    with browser.new_page(color_scheme="dark", viewport={"width": 390, "height": 844}) as page:
        page.goto((identified[0] / "fleet.html").as_uri())
        page.select_option("#lrm-tag", "batch")
        page.wait_for_selector("#lrm-parameter .main-svg", state="attached")
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        assert page.evaluate("document.documentElement.dataset.theme") == "light"
        box = "document.querySelector('#lrm-errors {}').getBoundingClientRect()"
        legend, chart = (page.evaluate(box.format(part) + ".toJSON()") for part in (".legend", ".gridlayer"))
        assert legend["bottom"] <= chart["top"] + 1
        page.evaluate("dispatchEvent(new Event('afterprint'))")
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"


@pytest.mark.slow
def test_fleet_from_manifest_to_prior(manifest: Path, identified: tuple[Path, str]) -> None:
    out, text = identified
    assert f"{ARMS} of {ARMS + 1} arms identified" in text
    assert "gone: " in text
    assert "no such file" in text
    assert f"arm{ODD}: joint1's compliance" in text
    result = json.loads(out.with_name("fleet.json").read_text())
    assert {one["arm"] for one in result["outliers"]} == {f"arm{ODD}"}
    assert result["population"][SOFT]["arms"] == ARMS - 1
    low, high = result["population"][SOFT]["mean_interval"]
    assert low < 0.02 < high
    rows = list(csv.DictReader((out / "fleet.csv").read_text().splitlines()))
    assert [row["name"] for row in rows] == [*(f"arm{k}" for k in range(ARMS)), "gone"]
    assert float(rows[ODD][SOFT]) == pytest.approx(0.2, rel=0.2)
    assert rows[-1]["reason"].endswith("no such file")
    page = (out / "fleet.html").read_text()
    assert "Arms unlike their sisters" in page
    assert 'src="http' not in page.split("<script>/**")[0]
    prior = read_toml(out / "prior.toml", PriorFile)
    known = prior.parameters[SOFT]
    assert abs(known.mean - 0.02) < 3 * known.sd < 0.02
    arm = load_arm(ARM)
    model = nominal_model(arm)
    assert load_prior(str(out / "prior.toml"), model).mean_of([SOFT])[0] == known.mean
    text = stdout_of("fit", manifest.parent / "arm0.csv", "--arm", ARM, "--prior", out / "prior.toml")
    assert "fleet manifest" in text


def test_what_is_done_is_not_done_again(manifest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that breaks off, one that goes on, and one after an arm's data have changed."""
    members, computed = read_manifest(manifest)[:4], list[str]()

    def recorded(task: running.ArmTask) -> ArmRecord:
        computed.append(task.name)
        return ArmRecord(name=task.name, sha256=task.sha256, reason="not tried")

    monkeypatch.setattr(running, "identify_arm", recorded)
    real_write, written = running.write_text, list[Path]()

    def full_disk(path: Path, text: str) -> None:
        written.append(path)
        if len(written) == 3:
            raise FileError(path, "", "cannot be written (No space left on device)")
        real_write(path, text)

    monkeypatch.setattr(running, "write_text", full_disk)
    with in_this_process() as executor, pytest.raises(FileError, match="No space left"):
        run_fleet(members, tmp_path / "out", executor)
    assert len(list((tmp_path / "out" / "arms").iterdir())) == 2
    monkeypatch.setattr(running, "write_text", real_write)
    kept = {path.stem for path in (tmp_path / "out" / "arms").iterdir()}
    computed.clear()
    with in_this_process() as executor:
        records = run_fleet(members, tmp_path / "out", executor)
    assert sorted(computed) == sorted({member.name for member in members} - kept)
    assert [record.name for record in records] == [member.name for member in members]
    changed = tmp_path / "arm0.csv"
    changed.write_text(members[0].data.read_text().replace(",0.0", ",1.0", 1))
    again = [running.FleetMember("arm0", changed, ARM, ()), *members[1:]]
    computed.clear()
    with in_this_process() as executor:
        run_fleet(again, tmp_path / "out", executor)
    assert computed == ["arm0"]


def test_a_broken_arm_is_a_reason(manifest: Path, tmp_path: Path) -> None:
    member = read_manifest(manifest)[0]
    broken = tmp_path / "arm0.csv"
    broken.write_text(member.data.read_text().replace("x_mm", "u_mm"))
    record = identify_arm(task_of(running.FleetMember("arm0", broken, ARM, ()), tmp_path))
    assert (record.model, record.sha256 != "") == ("", True)
    assert record.reason.startswith("arm0.csv: ")


@pytest.mark.soak
@pytest.mark.slow
def test_a_cluster_of_two_workers_finds_the_same_bit_for_bit(manifest: Path, tmp_path: Path, two_workers: str) -> None:
    members = read_manifest(manifest)[:2]
    with executor_for(two_workers) as executor:
        there = run_fleet(members, tmp_path / "there", executor)
    with executor_for(most=1) as executor:
        here = run_fleet(members, tmp_path / "here", executor)
    for one, other in zip(there, here, strict=True):
        assert one.reason == other.reason == ""
        assert _without_times(one) == _without_times(other)


def _without_times(record: ArmRecord) -> list[str]:
    """The lines of a record but those of dates and durations."""
    text = json.dumps(record.model_dump(by_alias=True) | {"seconds": 0.0}).replace("\\n", "\n")
    return [line for line in text.splitlines() if not line.startswith("date = ")]


def test_rates_weigh_p_values_with_mean_one() -> None:
    rates = EffectRates({"backlash@joint2": 0.8}, 0.02)
    names = ["backlash@joint2", *(f"other@{k}" for k in range(9))]
    weights = rates.weights(names)
    assert np.mean(list(weights.values())) == pytest.approx(1.0)
    assert weights["backlash@joint2"] == pytest.approx(40 * weights["other@0"])
    assert rates.weights([]) == {}


@pytest.mark.slow
def test_rates_of_a_prior_file_reach_diagnose_and_auto(manifest: Path, tmp_path: Path) -> None:
    """Equal rates change nothing."""
    path = tmp_path / "prior.toml"
    path.write_text('schema = "lrm/prior/1"\nname = "x"\n[effects]\n"backlash@joint2" = { rate = 0.9 }\n')
    assert load_rates(str(path)) == EffectRates({"backlash@joint2": 0.9}, 0.9)
    assert load_rates("vague") is None
    data, model = manifest.parent / "arm0.csv", tmp_path / "model.toml"
    stdout_of("fit", data, "--arm", ARM, "-o", model)
    plain, weighed = stdout_of("diagnose", model, data), stdout_of("diagnose", model, data, "--prior", path)
    assert plain == weighed
    assert "no such prior" in stderr_of("diagnose", model, data, "--prior", "none")
    better = tmp_path / "better.toml"
    said = stdout_of("auto", model, data, "--no-nested", "--max-effects", 1, "--prior", path, "-o", better)
    assert "Then refit: all" in said
    assert read_toml(better, ModelFile).history[-1].name == StepName(REFIT, "x")
