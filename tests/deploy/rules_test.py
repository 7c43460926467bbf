"""promtool reads the configuration and runs the tests of the alerts."""
import re
import subprocess
import unittest

from dashboards import ROOT

FOLDER = ROOT / "deploy/prometheus"
RULES = sorted((FOLDER / "rules").glob("*.yml"))
TESTS = sorted((FOLDER / "tests").glob("*.yml"))


class Rules(unittest.TestCase):
    def promtool(self, *arguments):
        done = subprocess.run(["promtool", *arguments], capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_the_configuration_is_valid(self):
        self.promtool("check", "config", FOLDER / "prometheus.yml")

    def test_the_rules_are_valid(self):
        self.promtool("check", "rules", "--lint-fatal", *RULES)

    def test_alerts_fire_when_they_should(self):
        self.promtool("test", "rules", *TESTS)

    def test_every_alert_has_a_test_that_it_fires_and_one_that_it_does_not(self):
        alerts = re.findall(r"- alert: (\w+)", (FOLDER / "rules/gem_alerts.yml").read_text())
        cases = "".join(path.read_text() for path in TESTS)
        self.assertEqual(len(alerts), len(set(alerts)))
        for alert in alerts:
            self.assertRegex(cases, rf"alertname: {alert}\n\s+exp_alerts:\n", alert)
            self.assertRegex(cases, rf"alertname: {alert}\n\s+exp_alerts: \[\]", alert)


if __name__ == "__main__":
    unittest.main()
