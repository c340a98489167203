"""Effects outside the catalogue: the same results as within it, refusals, and the place in the parameter file."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.effects import FORMS, TERM_EFFECTS, Effect, effect_named, every_form, forms_for, load_plugins, plugins
from rovid.model.bound_effects import pack_terms
from tests.conftest import Rovid, write_short_day
from tests.effects.test_effects import TIME, VEHICLE, numbers, simulated

TEMPLATE = Path(plugins.__file__).parent / "templates" / "own_effect.py"


@pytest.fixture(autouse=True)
def _nothing_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_LOADED", plugins._Loaded())  # noqa: SLF001 - what this process has loaded


@pytest.mark.parametrize("key", ["coulomb_resistance", "tank_seiche"])
def test_a_term_outside_the_catalogue_simulates_like_one_within(key: str) -> None:
    effect = effect_named(key)
    further = replace(effect, id="further")
    values = numbers(effect, start=True)
    torque = 100.0 * np.sign(np.sin(0.2 * TIME))
    assert pack_terms([(further, values)], 0.0).kinds[0] >= len(TERM_EFFECTS)
    # Both evaluate the same formula; the compilers may contract products.
    own, other = (simulated(one, values, torque) for one in (effect, further))
    assert np.ptp(own) > 0.01
    np.testing.assert_allclose(other, own, rtol=1e-12, atol=1e-14)


def plugin(tmp_path: Path, name: str, *changes: tuple[str, str]) -> Path:
    text = TEMPLATE.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / name).write_text(text)
    return tmp_path / name


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("EFFECT: Effect", "EFFECT: Effect ("), "SyntaxError"),
        (("EFFECT: Effect", "OTHER: Effect"), "it has no EFFECT"),
        (('id="own_effect"', 'id="thruster_lag"'), "the id thruster_lag is taken"),
        (('id="own_effect"', 'id="Own"'), "has other signs"),
        (("(at: Instant, p: Numbers)", "(at: Instant)"), "TypeError"),
        (("stiffness * maximum", "1.0 * maximum"), "is not zero at the neutral value of stiffness"),
        (("import annotations", "import annotations\n\nraise SystemExit(3)"), "SystemExit"),
        (("initial_values=(0.1,)", "initial_values=(9.0,)"), "outside low and high"),
        (('scale="torque"', 'scale="tonque"'), "scale 'tonque' of stiffness is unknown"),
        (("(at.angle -", "(float(str(at.angle)) -"), "Error"),
    ],
)
def test_a_broken_plugin_is_named_and_left_out(
    change: tuple[str, str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load_plugins([plugin(tmp_path, "broken.py", change)])
    (warning,) = plugins.plugin_warnings()
    assert warning.startswith("broken.py: this plug-in was left out")
    assert reason in warning
    assert warning in capsys.readouterr().err
    assert every_form() == FORMS


def test_what_a_plugin_prints_goes_to_stderr(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = plugin(tmp_path, "own.py", ("import annotations", "import annotations\n\nprint('hello')"))
    broken = plugin(tmp_path, "broken.py", ("EFFECT: Effect", "OTHER: Effect"))
    load_plugins([broken, path, path])
    output = capsys.readouterr()
    assert (output.out, output.err.splitlines()[-1]) == ("", "hello")
    assert [effect.id for effect in every_form()[len(FORMS) :]] == ["own_effect"]


def test_an_installed_package_adds_an_effect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "mine-2.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 2.1\n")
    (info / "entry_points.txt").write_text("[rovid.effects]\nmine = mine_effect\nlost = no_such_module\n")
    plugin(tmp_path, "mine_effect.py")
    monkeypatch.syspath_prepend(tmp_path)
    assert "own_effect" in [effect.id for effect in forms_for(VEHICLE)]
    assert plugins.origin("own_effect") == plugins.Origin(plugin="mine", version="2.1")
    assert "no_such_module" in plugins.plugin_warnings()[0]
    sys.modules.pop("mine_effect")


def test_the_parameter_file_names_the_plugin_and_refuses_without_it(tmp_path: Path, rovid: Rovid) -> None:
    own = plugin(tmp_path, "own.py")
    write_short_day(tmp_path / "day", runs=("coast_02", "hold_03", "sine_40s_a"))
    fitted = rovid("fit", "day", "--effect", "own_effect", "--effects-from", own, "--json").document
    assert "own_effect.stiffness" in fitted["parameters"]
    for command in ("simulate", "export json", "plan"):
        refused = rovid(*command.split())
        assert refused.code == 2
        assert "own_effect of the plug-in own.py (version sha256:" in refused.err
        assert "--effects-from own.py" in refused.err
    assert rovid("simulate", "--effects-from", own, "--json").document["effects"] == ["own_effect"]
    changed = plugin(tmp_path, "own.py", ("stiffness * maximum", "2.0 * stiffness * maximum"))
    refused = rovid("simulate", "--effects-from", changed)
    assert (refused.code, "Run `rovid fit --effect own_effect` again" in refused.err) == (2, True)
    missing = rovid("fit", "--effects-from", "none.py")
    assert (missing.code, "there is no such file" in missing.err) == (2, True)


def test_effects_of_the_catalogue_pass_the_check_of_plugins() -> None:
    def reasons(effect: Effect) -> str:
        try:
            plugins._check(replace(effect, id="further"), ())  # noqa: SLF001 - of the module under test
        except plugins._InvalidPluginError as error:  # noqa: SLF001 - as above
            return str(error)
        return ""

    some = ("slew_limit", "restoring_curve", "heading_deviation", "thruster_deadband")
    assert {name: reasons(effect_named(name)) for name in some} == dict.fromkeys(some, "")
