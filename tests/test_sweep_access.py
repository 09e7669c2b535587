"""Who can speak to a study's workers: only the process that began them, and those who hold a scheduler's certificates."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from synth.cli import main
from synth.study import clusters, sweeping
from synth.study.remote import Remote, certificates, remote
from tests.patience import until

ROOT = Path(__file__).resolve().parents[1]
ROWS = """
import time

def nap(settings):
    time.sleep(settings["seconds"])
    return {"y": settings["x"] / 7}
"""


def listening(process: psutil.Process) -> set[int]:
    """Ports at which a process and its descendants listen."""
    found = set()
    for each in (process, *process.children(recursive=True)):
        try:
            found |= {found.laddr.port for found in each.net_connections("inet") if found.status == psutil.CONN_LISTEN}
        except (psutil.NoSuchProcess, psutil.AccessDenied):
            continue
    return found


def study(folder: Path, rows: int, seconds: float) -> Path:
    (folder / "access_rows.py").write_text(ROWS)
    path = folder / "naps.toml"
    path.write_text(
        f'base = {{ call = "access_rows:nap", set = {{ seconds = {seconds} }} }}\n'
        f"grid.x = {{ from = 0, to = {rows - 1}, step = 1 }}\n"
    )
    return path


# --- workers of this machine --------------------------------------------------------------------------------


def test_workers_of_a_study_hear_nobody_but_it(tmp_path: Path) -> None:
    from synth.study.keeping import journalled

    files, folder = tmp_path / "temporary", tmp_path / "s"
    files.mkdir()
    command = [
        sys.executable,
        "-m",
        "synth",
        "sweep",
        str(study(tmp_path, 100_000, 0.05)),
        "-o",
        str(folder),
        "--workers",
        "1",
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(files)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            until(lambda: (folder.is_dir() and journalled(folder) > 2) or process.poll() is not None, "no row came")
            assert process.poll() is None
            (worker,) = [each for each in psutil.Process(process.pid).children() if "spawn_main" in " ".join(each.cmdline())]
            assert worker.environ()["OMP_NUM_THREADS"] == "1" and "MALLOC_TRIM_THRESHOLD_" not in worker.environ()
            assert listening(psutil.Process(process.pid)) == set() and not list(files.iterdir())
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate()
    assert not list(files.iterdir())


def test_a_port_would_be_seen() -> None:
    """Else that there is none would say nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        assert server.getsockname()[1] in listening(psutil.Process())


# --- schedulers at an address -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "address",
    ["tcp://192.0.2.7:8786", "192.0.2.7:8786", "ws://192.0.2.7:8786", "ucx://[2001:db8::7]:8786", "tcp://0.0.0.0:1"],
)
def test_traffic_that_is_not_encrypted_stays_here(address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="is not encrypted and not on this machine"):
        remote(address)
    assert remote(address, insecure=True) == Remote(address)
    path = study(tmp_path, 1, 0.0)
    assert main(["sweep", str(path), "-o", str(tmp_path / "s"), "--scheduler", address]) == 2
    assert "--insecure" in capsys.readouterr().err and not (tmp_path / "s").exists()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "127.8.9.1:8786", "tcp://[::1]:8786", "tcp://localhost:8786"])
def test_addresses_of_this_machine_are_taken(address: str) -> None:
    assert remote(address) == Remote(address)


@pytest.mark.parametrize("address", ["", "tcp://", "tls://:8786", "tcp://[::1"])
def test_what_is_no_address_is_said(address: str) -> None:
    with pytest.raises(ValueError, match="must be an address such as tls://HOST:8786"):
        remote(address)


@pytest.fixture(scope="module")
def pem(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """cert.pem, key.pem of a cluster, other.pem of another."""
    from distributed.security import Security

    folder = tmp_path_factory.mktemp("pem")
    mine, other = Security.temporary(), Security.temporary()
    (folder / "cert.pem").write_text(mine.tls_ca_file)
    (folder / "key.pem").write_text(mine.tls_client_key)
    (folder / "both.pem").write_text(mine.tls_client_key + mine.tls_ca_file)
    (folder / "other.pem").write_text(other.tls_client_key + other.tls_ca_file)
    (folder / "text.pem").write_text("no certificate")
    return folder


@contextmanager
def guarded(pem: Path) -> Iterator[str]:
    """Address of a scheduler with certificates and a worker."""
    from distributed import LocalCluster
    from distributed.security import Security

    cert, key = str(pem / "cert.pem"), str(pem / "key.pem")
    roles = {f"tls_{role}_{what}": path for role in ("client", "scheduler", "worker")
             for what, path in (("cert", cert), ("key", key))}  # fmt: skip
    security = Security(require_encryption=True, tls_ca_file=cert, **roles)
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", protocol="tls",
                      security=security) as cluster:  # fmt: skip
        yield cluster.scheduler_address


def test_a_scheduler_with_certificates(
    pem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import dask

    path = study(tmp_path, 4, 0.0)
    with guarded(pem) as address:
        assert address.startswith("tls://")
        asked = ["sweep", str(path), "--scheduler", address, "-o"]
        assert main([*asked, str(tmp_path / "none")]) == 2
        assert "needs certificates; give --tls-ca" in capsys.readouterr().err
        given = ["--tls-ca", str(pem / "cert.pem"), "--tls-cert", str(pem / "both.pem")]
        assert main([*asked, str(tmp_path / "option"), *given]) == 0
        assert len(sweeping.read_table(tmp_path / "option")) == 4
        files = {"ca-file": "cert.pem", "client.cert": "cert.pem", "client.key": "key.pem"}
        with dask.config.set({f"distributed.comm.tls.{name}": str(pem / file) for name, file in files.items()}):
            assert len(sweeping.sweep(path, tmp_path / "configured", scheduler=address)) == 4
        other = certificates(pem / "other.pem", pem / "other.pem")
        with pytest.raises(OSError, match=r"nothing answers at tls://.*check the address, the certificates"):
            clusters.Dask({}, Remote(address, other), wait_s=2)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--insecure"], "--insecure is for a scheduler; give --scheduler"),
        (["--tls-ca", "x"], "--tls-ca is for a scheduler; give --scheduler"),
        (["--scheduler", "tls://127.0.0.1:1", "--tls-key", "x"], "--tls-key needs --tls-ca and --tls-cert"),
        (["--scheduler", "tls://127.0.0.1:1", "--tls-ca", "x", "--tls-cert", "{cert}"], "--tls-ca: x is not a file"),
        (["--scheduler", "tls://127.0.0.1:1", "--tls-ca", "{text}", "--tls-cert", "{both}"], "{text} has no certificate"),
        (["--scheduler", "tls://127.0.0.1:1", "--tls-ca", "{cert}", "--tls-cert", "{cert}"], "--tls-cert: {cert} have no"),
        (["--scheduler", "tls://127.0.0.1:1", "--tls-ca", "{cert}", "--tls-cert", "{cert}", "--tls-key", "{other}"],
         "--tls-cert, --tls-key: {cert} and {other} have no certificate and its key"),
        (["--scheduler", "tcp://127.0.0.1:1", "--tls-ca", "{cert}", "--tls-cert", "{both}"], "begins with tls://, got tcp"),
    ],
)  # fmt: skip
def test_certificates_that_cannot_be_taken_are_named(
    options: list[str], told: str, pem: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {path.stem: str(path) for path in pem.iterdir()}
    path = study(tmp_path, 1, 0.0)
    assert main(["sweep", str(path), "-o", str(tmp_path / "s"), *(each.format(**names) for each in options)]) == 2
    said = capsys.readouterr().err
    assert told.format(**names) in said and "Traceback" not in said and not (tmp_path / "s").exists()
