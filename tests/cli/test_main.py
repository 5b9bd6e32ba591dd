import importlib
import subprocess
import sys

import pytest

from scan2fea.cli.main import main


def test_help_needs_no_heavy_library():
    code = (
        "import sys; from scan2fea.cli.parser import parser; parser(); print([m for m in ('numpy','scipy','numba','gmsh','OCP') if m in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


@pytest.mark.parametrize("arguments", [["run"], ["run", "a.ply"], ["nonsense"], [], ["run", "a", "-o", "b", "--sed", "1"]])
def test_usage_is_two(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2


@pytest.mark.parametrize("setting", ["run.sed=1", "run.seed", "=3", "run.seed=x"])
def test_wrong_setting_is_two_and_one_line(setting, tmp_path, capsys):
    assert main(["run", "a.ply", "-o", str(tmp_path / "o"), "--set", setting]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_config_prints_toml(capsys):
    import tomllib

    assert main(["config", "--set", "run.seed=4"]) == 0
    assert tomllib.loads(capsys.readouterr().out)["run"]["seed"] == 4


@pytest.mark.parametrize("command", [["check"], ["info"]])
def test_missing_file_is_three(command, tmp_path, capsys):
    assert main([*command, str(tmp_path / "none.stl")]) == 3
    told = capsys.readouterr().err
    assert "none.stl" in told
    assert len(told.strip().splitlines()) == 1


def test_missing_input_is_three(tmp_path):
    assert main(["run", str(tmp_path / "none.ply"), "-o", str(tmp_path / "out")]) == 3


def test_folder_of_others_is_left_alone(tmp_path):
    mine = tmp_path / "thesis.txt"
    mine.write_text("precious")
    assert main(["run", str(tmp_path / "none.ply"), "-o", str(tmp_path)]) == 2
    assert mine.read_text() == "precious"


def test_resume_of_nothing_is_two(tmp_path):
    assert main(["run", str(tmp_path / "none.ply"), "-o", str(tmp_path / "out"), "--resume"]) == 2


@pytest.mark.parametrize(
    ("words", "says"), [(["run", "a.ply", "-o", "O"], "--resume"), (["thesis"], "the same command"), (["info", "a.ply"], "interrupted\n")]
)
@pytest.mark.parametrize("in_kernel", [0, 1, 2])
def test_an_interruption_tells_how_to_go_on_where_there_is_a_way(words, says, in_kernel, monkeypatch, capsys):
    def stopped(_):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            fault: BaseException = interrupt
            for _ in range(in_kernel):  # twice where a kernel was being loaded
                error = SystemError("a kernel returned a result with an exception set")
                error.__cause__, fault = fault, error
            raise fault from fault.__cause__

    module = importlib.import_module(f"scan2fea.cli.{words[0]}_command")
    monkeypatch.setattr(module, "execute", stopped)
    assert main(words) == 130
    told = capsys.readouterr().err
    assert says in told and ("--resume" in told) == (words[0] == "run")
