"""Debian's Prometheus watches a loaded server: every expression of every panel and rule must answer.

GEM_BIN names the folder of gem and gem_server; default: build/release/bin.
"""
import math
import os
import re
import unittest

from dashboards import ROOT, expressions_of, load_all, metrics_of
from monitored_server import MonitoredServer, wait_until

# Nothing answers while all is well, and that is their point.
EMPTY_WHILE_ALL_IS_WELL = {'absent(up{job="gem_server"})'}
# Families of the page that no dashboard shows.
NOT_SHOWN = {"exposer_request_latencies"}

RULES_S_MAX = 30


def as_numbers(condition):
    """An alert's condition that answers 0 or 1 instead of nothing or something."""
    parts = re.split(r"(\{[^}]*\})", condition)  # comparisons in braces are of labels
    parts[::2] = [re.sub(r"(==|!=|>=|<=|>|<)(?! *bool)", r"\1 bool", part) for part in parts[::2]]
    return "".join(parts)


class Monitoring(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.monitored = MonitoredServer(os.environ.get("GEM_BIN", ROOT / "build/release/bin"))
        cls.enterClassContext(cls.monitored)
        cls.monitored.load()
        cls.page = cls.monitored.page()
        cls.rules = [rule for group in cls.monitored.ask("rules")["groups"] for rule in group["rules"]]

    def assert_answers(self, expression):
        values = self.monitored.query(expression)
        self.assertTrue(values, "no data: " + expression)
        self.assertTrue(any(not math.isnan(value) for value in values), "only NaN: " + expression)

    def test_every_panel_answers(self):
        count = 0
        for name, dashboard in load_all():
            for title, expression in expressions_of(dashboard):
                with self.subTest(dashboard=name, panel=title):
                    self.assert_answers(expression)
                    count += 1
        print(f"{count} expressions of panels answered")
        self.assertGreater(count, 80)

    def test_every_rule_answers(self):
        self.assertGreater(len(self.rules), 20)
        for rule in self.rules:
            with self.subTest(rule=rule["name"]):
                self.assertEqual(rule["health"], "ok", rule.get("lastError"))
                if rule["query"] not in EMPTY_WHILE_ALL_IS_WELL:
                    self.assert_answers(as_numbers(rule["query"]))
        print(f"{len(self.rules)} rules answered")

    def test_every_recorded_series_is_there(self):
        for name in (rule["name"] for rule in self.rules if rule["type"] == "recording"):
            with self.subTest(name):
                wait_until(name, lambda name=name: self.monitored.query(name), RULES_S_MAX)
                self.assert_answers(name)

    def test_nothing_is_wrong_with_a_healthy_server(self):
        firing = [alert["labels"]["alertname"] for alert in self.monitored.ask("alerts")["alerts"]
                  if alert["state"] == "firing"]
        # A machine that is busy with other things may be late.
        late = {"GemScansLate", "GemScansLateForHours", "GemReadsLate", "GemReadsLateForHours"}
        self.assertEqual(set(firing) - late, set())

    def test_every_metric_that_is_named_is_on_the_page(self):
        samples = set(re.findall(r"^([a-z_]+)", self.page, re.MULTILINE))
        recorded = {rule["name"] for rule in self.rules}
        expressions = [expression for _, dashboard in load_all() for _, expression in expressions_of(dashboard)]
        for expression in expressions + [rule["query"] for rule in self.rules]:
            self.assertEqual(metrics_of(expression) - samples - recorded, set(), expression)

    def test_every_metric_of_the_page_is_on_a_dashboard(self):
        families = set(re.findall(r"^# TYPE (\S+)", self.page, re.MULTILINE))
        shown = {re.sub(r"_(bucket|sum|count)$", "", metric) for _, dashboard in load_all()
                 for _, expression in expressions_of(dashboard) for metric in metrics_of(expression)}
        self.assertEqual(families - shown, NOT_SHOWN)

    def test_watchers_are_counted(self):
        self.assertGreater(sum(self.monitored.query('gem_rpc_sent_messages_total{method="WatchTiles"}')), 1)
        self.assertGreater(sum(self.monitored.query('max_over_time(gem_rpc_active_calls{method="WatchTiles"}[5m])')), 0)

    def test_variables_have_values(self):
        for name, dashboard in load_all():
            for variable in dashboard["templating"]["list"]:
                if variable["type"] == "query":
                    series, label = re.fullmatch(r"label_values\((.*), (\w+)\)", variable["query"]).groups()
                    values = self.monitored.ask(f"label/{label}/values",
                                                **{"match[]": series.replace("$instance", ".*")})
                    self.assertTrue(values, (name, variable["name"]))

    def test_the_check_sees_what_does_not_answer(self):
        for wrong in ("gem_nonsense_total", "0 / 0", 'gem_scans_total{result="nonsense"}'):
            with self.assertRaises(AssertionError):
                self.assert_answers(wrong)
        self.assertEqual(as_numbers('a{b!="c"} > 1 and d == 0'), 'a{b!="c"} > bool 1 and d == bool 0')


if __name__ == "__main__":
    unittest.main()
