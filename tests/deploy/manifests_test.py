"""Container, systemd unit and Kubernetes manifests: what can be checked without running a cluster."""
import os
import pathlib
import re
import subprocess
import tempfile
import time
import unittest

import yaml

from dashboards import ROOT
from monitored_server import START_S_MAX, free_port, wait_until

DEPLOY = ROOT / "deploy"
BIN = pathlib.Path(os.environ.get("GEM_BIN", ROOT / "build/release/bin"))
GRPC_PORT, METRICS_PORT = 50051, 9464
# systemd-analyze's scale is 0 (safe) to 10; it is given times ten.
EXPOSURE_MAX = 15


def read(path):
    return yaml.safe_load((DEPLOY / path).read_text())


class Kubernetes(unittest.TestCase):
    def setUp(self):
        self.deployment = read("kubernetes/deployment.yaml")
        self.pod = self.deployment["spec"]["template"]
        self.container, = self.pod["spec"]["containers"]

    def test_one_server_owns_the_maps(self):
        self.assertEqual(self.deployment["spec"]["replicas"], 1)
        self.assertEqual(self.deployment["spec"]["strategy"], {"type": "Recreate"})

    def test_the_pod_may_do_nothing_but_serve(self):
        self.assertTrue(self.pod["spec"]["securityContext"]["runAsNonRoot"])
        self.assertFalse(self.pod["spec"]["automountServiceAccountToken"])
        self.assertEqual(self.container["securityContext"], {
            "allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True, "capabilities": {"drop": ["ALL"]}})

    def test_probes_and_resources_are_set(self):
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            self.assertEqual(self.container[probe]["grpc"]["port"], GRPC_PORT)
        self.assertIn("memory", self.container["resources"]["limits"])
        self.assertEqual(set(self.container["resources"]["requests"]), {"cpu", "memory"})

    def test_selectors_and_ports_fit_the_pod(self):
        labels = self.pod["metadata"]["labels"].items()
        service, monitor = read("kubernetes/service.yaml"), read("kubernetes/pod_monitor.yaml")
        for selector in (self.deployment["spec"]["selector"]["matchLabels"], service["spec"]["selector"],
                         monitor["spec"]["selector"]["matchLabels"]):
            self.assertLessEqual(selector.items(), labels)
        names = {port["name"]: port["containerPort"] for port in self.container["ports"]}
        self.assertEqual(names, {"grpc": GRPC_PORT, "metrics": METRICS_PORT})
        self.assertEqual({port["targetPort"] for port in service["spec"]["ports"]}, set(names))
        self.assertEqual(monitor["spec"]["podMetricsEndpoints"][0]["port"], "metrics")
        self.assertEqual(self.pod["metadata"]["annotations"]["prometheus.io/port"], str(METRICS_PORT))

    def test_the_kustomization_names_files_that_are_there(self):
        kustomization = read("kubernetes/kustomization.yaml")
        files = kustomization["resources"] + kustomization["configMapGenerator"][0]["files"]
        for name in files:
            self.assertTrue((DEPLOY / "kubernetes" / name).is_file(), name)
        volume, = self.pod["spec"]["volumes"]
        self.assertEqual(volume["configMap"]["name"], kustomization["configMapGenerator"][0]["name"])


class Container(unittest.TestCase):
    def setUp(self):
        self.lines = (DEPLOY / "Dockerfile").read_text()
        self.services = read("compose.yaml")["services"]

    def test_it_is_nobody_and_says_how_it_is(self):
        self.assertRegex(self.lines, r"(?m)^USER 10001:10001$")
        self.assertRegex(self.lines, r"(?m)^HEALTHCHECK ")
        self.assertRegex(self.lines, rf"(?m)^EXPOSE {GRPC_PORT} {METRICS_PORT}$")
        self.assertEqual(len(re.findall(r"(?m)^FROM ", self.lines)), 2)

    def test_what_is_mounted_and_scraped_is_there(self):
        for service in self.services.values():
            for volume in service["volumes"]:
                if volume.startswith("./"):
                    self.assertTrue((DEPLOY / volume.split(":")[0]).exists(), volume)
        target, = read("prometheus/prometheus.yml")["scrape_configs"][0]["static_configs"][0]["targets"]
        host, port = target.split(":")
        self.assertIn(host, self.services)
        self.assertEqual(int(port), METRICS_PORT)
        source, = read("grafana/provisioning/datasources/prometheus.yaml")["datasources"]
        self.assertEqual(source["url"], "http://prometheus:9090")

    def test_everything_is_reached_from_this_machine_only(self):
        for service in self.services.values():
            for port in service["ports"]:
                self.assertTrue(port.startswith("127.0.0.1:"), port)


class Unit(unittest.TestCase):
    def test_systemd_takes_it(self):
        text = (DEPLOY / "systemd/gem_server.service").read_text()
        with tempfile.TemporaryDirectory() as folder:
            # The binary must be there to be verified.
            unit = pathlib.Path(folder) / "gem_server.service"
            unit.write_text(text.replace("/usr/local/bin/gem_server", str(BIN.resolve() / "gem_server")))
            done = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_it_exposes_little(self):
        done = subprocess.run(["systemd-analyze", "security", "--offline=true", f"--threshold={EXPOSURE_MAX}",
                               DEPLOY / "systemd/gem_server.service"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)


class HealthProbe(unittest.TestCase):
    """The command of the container's HEALTHCHECK, and the configuration of its cluster."""

    def probe(self, address):
        begun = time.monotonic()
        code = subprocess.run([BIN / "gem", "status", "--server", address, "--json"], capture_output=True,
                              timeout=30).returncode
        return code, time.monotonic() - begun

    def test_a_server_that_is_gone_is_not_healthy(self):
        code, seconds = self.probe(f"127.0.0.1:{free_port()}")
        self.assertNotEqual(code, 0)
        self.assertLess(seconds, 3)

    def test_a_server_with_the_cluster_s_configuration_is_healthy(self):
        with tempfile.TemporaryFile("w+") as out, subprocess.Popen(
                [BIN / "gem_server", "--config", DEPLOY / "kubernetes/gem_server.yaml", "--listen", "127.0.0.1:0",
                 "--metrics_listen", "127.0.0.1:0"], stdout=out) as server:
            try:
                def ready():
                    self.assertIsNone(server.poll(), "the server ended")
                    out.seek(0)
                    return re.search(r"grpc=(\S+)", out.read())

                address = wait_until("the start of gem_server", ready, START_S_MAX).group(1)
                self.assertEqual(self.probe(address)[0], 0)
            finally:
                server.terminate()


if __name__ == "__main__":
    unittest.main()
