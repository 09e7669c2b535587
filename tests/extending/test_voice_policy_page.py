"""docs/extending/voice-policy.md does what it says."""

from tests.extending.pages import type_commands, write_files


def test_the_page_runs(tmp_path):
    assert [path.name for path in write_files("voice-policy", tmp_path)] == ["oldest.py", "test_oldest.py", "hear.py"]
    for _ in range(2):  # compiled, and found again on disk
        tested, heard = type_commands("voice-policy", tmp_path)
        assert "1 passed" in tested
        assert heard == "1 stolen\n"
