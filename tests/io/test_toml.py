"""Settings from TOML, and the lines on which keys stand."""

import tomllib

import pytest

from tensegraph import InputError, Settings
from tensegraph.io.toml import line_of, read_settings


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
            ("[noise]\nrobust = 'hard'\n", r"noise.robust: .*got 'hard'"),
            ("probability = 95\n", r"probability: .*got 95"),
            ("[smoother]\nlag = 1\n", r"smoother.lag: .*got 1"),
            ("probability = \n", r"cannot be read as TOML"),
            ("[frames]\nrate_hz = 0\n", r"frames.rate_hz: .*got 0"),
        ],
    )
    def test_what_is_no_setting_is_refused(self, tmp_path, text, message) -> None:
        path = tmp_path / "config.toml"
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_settings(path)

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
