"""A gem_server under load with Prometheus watching it, all on free ports of 127.0.0.1."""
import contextlib
import json
import pathlib
import re
import socket
import subprocess
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request

from dashboards import ROOT

START_S_MAX = 30
SCRAPES_S_MAX = 60
LOAD_S_MAX = 120


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


def wait_until(what, done, seconds_max):
    """The first answer of `done` that is true."""
    deadline = time.monotonic() + seconds_max
    while time.monotonic() < deadline:
        answer = done()
        if answer:
            return answer
        time.sleep(0.1)
    raise TimeoutError(f"{what} took longer than {seconds_max} s")


def get(url):
    with urllib.request.urlopen(url, timeout=10) as answer:
        return answer.read().decode()


class MonitoredServer:
    """with MonitoredServer(bin_dir) as monitored: ..."""

    def __init__(self, bin_dir):
        self.bin = pathlib.Path(bin_dir)
        self.stack = contextlib.ExitStack()

    def __enter__(self):
        with contextlib.ExitStack() as stack:
            self.folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
            self._start_server(stack)
            self._start_prometheus(stack)
            self.stack = stack.pop_all()
        return self

    def __exit__(self, *failure):
        self.stack.close()

    def page(self):
        return get(f"http://{self.metrics}/metrics")

    def ask(self, path, **parameters):
        """The field "data" of an answer of Prometheus's HTTP API."""
        query = urllib.parse.urlencode(parameters, doseq=True)
        try:
            return json.loads(get(f"http://{self.prometheus}/api/v1/{path}?{query}"))["data"]
        except urllib.error.HTTPError as error:
            raise ValueError(f"{parameters}: {error.read().decode()}") from None

    def query(self, expression):
        """Values of the series, as floats."""
        data = self.ask("query", query=expression)
        if data["resultType"] == "scalar":
            return [float(data["result"][1])]
        return [float(series["value"][1]) for series in data["result"]]

    def load(self):
        """A robot drives for ten seconds, is corrected, planners read and watch; then three more scrapes."""
        self.wait_for_scrapes(1)
        robot = ["simulate", "block", "--robot", "r1", "--rings", "16", "--azimuths", "256", "--submap_length_m", "3",
                 "--rate", "10", "--scans", "100", "--correct_at", "30,60,end", "--map", "site"]
        with self._gem(*robot) as driving:
            wait_until("the first tile", lambda: re.search(r"^gem_tiles\{.*\} [1-9]", self.page(), re.M), LOAD_S_MAX)
            deadline = time.monotonic() + LOAD_S_MAX
            with self._gem("watch", "--map", "site") as watching:
                while driving.poll() is None:
                    self._read()
                    time.sleep(0.5)
                    if time.monotonic() > deadline:
                        driving.kill()
                self.wait_for_scrapes(1)
                watching.terminate()
        if driving.returncode != 0:
            raise RuntimeError(f"gem simulate ended with {driving.returncode}")
        self._read()
        self.wait_for_scrapes(3)

    def wait_for_scrapes(self, count):
        before = self._num_scrapes()
        wait_until(f"{count} scrapes", lambda: self._num_scrapes() >= before + count, SCRAPES_S_MAX)

    def _num_scrapes(self):
        return sum(self.query('count_over_time(up{job="gem_server"}[1h])'))

    def _gem(self, *arguments):
        return subprocess.Popen([self.bin / "gem", *arguments, "--server", self.grpc], stdout=subprocess.DEVNULL)

    def _read(self):
        """What planners and people ask."""
        for command in (["export", "--map", "site", "--layer", "elevation", "--out", str(self.folder / "map.asc")],
                        ["local", "--robot", "r1", "--layer", "elevation", "--out", str(self.folder / "local.asc")],
                        ["status"]):
            with self._gem(*command) as reading:
                if reading.wait(LOAD_S_MAX) != 0:
                    raise RuntimeError(f"gem {command[0]} ended with {reading.returncode}")

    def _start(self, stack, name, command):
        log = self.folder / (name + ".txt")
        with open(log, "wb") as out:
            process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, cwd=self.folder)

        def stop():
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

        stack.callback(stop)

        def alive():
            if process.poll() is not None:
                raise RuntimeError(f"{name} ended with {process.returncode}:\n{log.read_text()}")
            return log.read_text()

        return alive

    def _start_server(self, stack):
        alive = self._start(stack, "gem_server", [self.bin.resolve() / "gem_server", "--listen", "127.0.0.1:0",
                                                  "--metrics_listen", "127.0.0.1:0"])
        ready = wait_until("the start of gem_server",
                           lambda: re.search(r"ready grpc=(\S+) metrics=(\S+)", alive()), START_S_MAX)
        self.grpc, self.metrics = ready.groups()

    def _start_prometheus(self, stack):
        """With the configuration that is shipped: other targets, and no patience."""
        shipped = ROOT / "deploy/prometheus"
        config = (shipped / "prometheus.yml").read_text()
        for pattern, replacement in ((r"targets: \[gem_server:9464\]", f"targets: ['{self.metrics}']"),
                                     (r"scrape_interval: \w+", "scrape_interval: 1s"),
                                     (r"evaluation_interval: \w+", "evaluation_interval: 1s"),
                                     (r"- rules/", f"- {shipped}/rules/")):
            config, count = re.subn(pattern, replacement, config)
            assert count == 1, pattern
        (self.folder / "prometheus.yml").write_text(config)
        self.prometheus = f"127.0.0.1:{free_port()}"
        alive = self._start(stack, "prometheus", [
            "prometheus", f"--config.file={self.folder}/prometheus.yml", f"--storage.tsdb.path={self.folder}/data",
            f"--web.listen-address={self.prometheus}"])

        def ready():
            alive()
            with contextlib.suppress(urllib.error.URLError, ConnectionError):
                return get(f"http://{self.prometheus}/-/ready")

        wait_until("the start of prometheus", ready, START_S_MAX)
