"""Settings from TOML, and the lines on which keys stand."""

import tomllib
from contextlib import suppress
from dataclasses import asdict

import pytest

from tensegraph import InputError, Settings
from tensegraph.io.toml import MOST_PARSED, line_of, read_settings


class TestSettings:
    def test_a_file_changes_what_it_names(self, tmp_path) -> None:
        path = tmp_path / "config.toml"
        path.write_text('probability = 0.9\n[noise]\nrod_m = 0.001\nrobust = "huber"\nshape_prior_m = inf\n')
        settings = read_settings(path)
        assert (settings.probability, settings.noise.rod_m, settings.noise.robust) == (0.9, 0.001, "huber")
        assert settings.front_end == Settings().front_end

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("[noise]\nrods_m = 1\n", r"config.toml: noise.rods_m: is no setting"),
            ("speed = 1\n", r"speed: is no setting"),
            ("[noise]\nrod_m = -1\n", r"noise.rod_m: .*greater than 0.*got -1"),
            ("[noise]\nrod_m = nan\n", r"noise.rod_m: .*got nan"),
            ("[noise]\nrod_m = 1e-9\n", r"noise.rod_m: .*at least 1e-06, got 1e-09"),
            ("[pose]\nlifted_m = 100\n", r"pose.lifted_m: expected 1e-05 to 50, got 100: is the unit right\?"),
            ("[pose]\nturn_rad_per_s = 300\n", r"pose.turn_rad_per_s: .*at most 35, got 300"),
            ("[rest]\nmeasured_sigma_m = 1e-9\n", r"rest.measured_sigma_m: expected .*got 1e-09: is the unit right\?"),
            ("[noise]\nforce_n = inf\n", r"noise.force_n: .*finite number, got inf"),
            ("[noise]\nrods_m = 1\n", r"lists them all: did you mean rod_m\?$"),
            ("[noise]\nrobust = 'hard'\n", r"noise.robust: .*got 'hard'"),
            ("[doubt]\nloaded_share = 5e-324\n", r"doubt.loaded_share: .*expected at least 1e-12, got 5e-324"),
            ("probability = 95\n", r"probability: .*got 95"),
            ("[smoother]\nlag = 1\n", r"smoother.lag: .*got 1"),
            ("probability = \n", r"cannot be read as TOML"),
            ("[frames]\nrate_hz = 0\n", r"frames.rate_hz: .*got 0"),
            (f"probability = 0x{'F' * 6000}\n", r"probability: expected a whole number of 64 bits.*one of 24000 bits"),
            (
                f"[smoother]\nlag = {'1' * 5000}\n",
                r"config.toml: cannot .*: line 2: expected .* 64 bits, .*one of 5000 digits$",
            ),
            (
                f"a = {'[' * 50_000}",
                r"cannot be read as TOML: expected at most 64 tables and lists within one another$",
            ),
            (f"[smoother]\nlag = [1, {2**63}]\n", r"smoother.lag\[1\]: expected a whole number of 64 bits"),
            (".".join("a" * 70) + " = 1\n", r"cannot be read as TOML: expected a key of at most 64 parts"),
            (".".join("a" * 20000) + " = 1\n", r"cannot be read as TOML: expected a key of at most 64 parts"),
            ("a = " + "{b.b.b.b = " * 30 + "1" + "}" * 30, r"a.b.b.*: expected at most 64 tables and lists"),
        ],
    )
    def test_what_is_no_setting_is_refused(self, tmp_path, text, message) -> None:
        path = tmp_path / "config.toml"
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_settings(path)

    def test_the_least_whole_number_of_64_bits_is_one(self, tmp_path) -> None:
        path = tmp_path / "config.toml"
        path.write_text(f"[smoother]\nlag = {-(2**63)}\n")
        with pytest.raises(InputError, match=r"smoother\.lag: expected a number of at least 2, got"):
            read_settings(path)

    def test_only_the_prior_of_the_shape_may_be_infinite(self, tmp_path) -> None:
        """Infinity is no prior; anywhere else it meets another one, and their difference is no number."""
        path = tmp_path / "config.toml"
        allowed = []
        for part, settings in asdict(Settings()).items():
            numbers = settings if isinstance(settings, dict) else {}
            for name in [name for name, value in numbers.items() if isinstance(value, float)]:
                path.write_text(f"[{part}]\n{name} = inf\n")
                with suppress(InputError):
                    read_settings(path)
                    allowed.append(f"{part}.{name}")
        assert allowed == ["noise.shape_prior_m"]

    def test_no_file_means_the_defaults(self, tmp_path) -> None:
        assert read_settings(None) == Settings()
        with pytest.raises(InputError, match="no such file"):
            read_settings(tmp_path / "none.toml")


def test_lines_of_keys() -> None:
    text = 'a = 1\n\n[t] # x\nb = [\n  [0],\n  [1],\n]\ns = """\n[u]\n"""\n[[t.l]]\nc = 1\n[[t.l]]\nd.e = 2\n'
    assert tomllib.loads(text)["t"]["l"][1] == {"d": {"e": 2}}
    lines = {"a": 1, "t": 3, "t.b": 4, "t.b[1][0]": 4, "t.s": 8, "t.l[0].c": 12, "t.l[1]": 13, "t.l[1].d.e": 14, "z": 1}
    assert {key: line_of(text, key) for key in lines} == lines


def test_a_statement_of_thousands_of_lines_is_parsed_a_few_times(monkeypatch) -> None:
    """Parsing it anew with each of its lines takes hours, and so does counting its brackets anew."""
    text = "[a]\nlong = [\n" + "    1,\n" * 100_000 + "]\nafter = 3\n"
    parsed = []
    loads = tomllib.loads
    monkeypatch.setattr("tensegraph.io.toml.tomllib.loads", lambda some: parsed.append(len(some)) or loads(some))
    assert line_of(text, "a.after") == 100_004
    assert sum(parsed) < 3 * len(text)


def test_a_text_of_thousands_of_lines_between_quotes_is_parsed_until_a_line_is_not_worth_it(monkeypatch) -> None:
    """Each of its lines might end the statement; parsing it anew with each takes minutes."""
    text = "a = 1\nlong = '''\n" + "x\n" * 20_000 + "'''\nafter = 3\n"
    parsed = []
    loads = tomllib.loads
    monkeypatch.setattr("tensegraph.io.toml.tomllib.loads", lambda some: parsed.append(len(some)) or loads(some))
    assert (line_of(text, "a"), line_of(text, "after")) == (1, 1)
    assert sum(parsed) <= 2 * MOST_PARSED
