"""Pages are read as they say."""

import pytest

from tests.extending import pages

PAGE = """A page.

```python title="a.py"
print("first")
```

What is only shown:

```python
raise SystemExit("not run")
```

```sh
python a.py
python -c "import synth; print(synth.__name__)"
```

```python title="a.py"
print("second")
```

```toml title="sub/b.toml"
x = "``` is no end"
```
"""


def test_files_and_commands_of_a_page():
    assert pages.files_of(PAGE) == {
        "a.py": 'print("first")\nprint("second")\n',
        "sub/b.toml": 'x = "``` is no end"\n',
    }
    assert pages.commands_of(PAGE) == ["python a.py", 'python -c "import synth; print(synth.__name__)"']


def test_a_page_is_written_out_and_run(tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "FOLDER", tmp_path)
    (tmp_path / "page.md").write_text(PAGE, encoding="utf-8")
    (tmp_path / "here").mkdir()
    assert [path.name for path in pages.write_files("page", tmp_path / "here")] == ["a.py", "b.toml"]
    assert pages.type_commands("page", tmp_path / "here") == ["first\nsecond\n", "synth\n"]


def test_what_fails_is_said(tmp_path):
    with pytest.raises(AssertionError, match="ended with 3"):
        pages.run(tmp_path, "python", "-c", "raise SystemExit(3)")
