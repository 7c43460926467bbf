"""What can be said of dashboards without running anything."""
import collections
import subprocess
import sys
import unittest

from dashboards import ROOT, load_all, panels_of


def repeated(values):
    return [value for value, count in collections.Counter(values).items() if count > 1]


def overlap(a, b):
    a, b = a["gridPos"], b["gridPos"]
    return (a["x"] < b["x"] + b["w"] and b["x"] < a["x"] + a["w"]
            and a["y"] < b["y"] + b["h"] and b["y"] < a["y"] + a["h"])


class Dashboards(unittest.TestCase):
    def setUp(self):
        self.all = load_all()
        self.assertEqual(len(self.all), 6)

    def each_panel(self):
        """(where, panel) pairs without rows."""
        for name, dashboard in self.all:
            for panel in panels_of(dashboard):
                if panel["type"] != "row":
                    yield (name, panel["title"]), panel

    def test_are_what_their_source_writes(self):
        subprocess.run([sys.executable, ROOT / "deploy/grafana/dashboards.py", "--check"], check=True)

    def test_uids_and_titles_are_unique(self):
        self.assertEqual(repeated(dashboard["uid"] for _, dashboard in self.all), [])
        self.assertEqual(repeated(dashboard["title"] for _, dashboard in self.all), [])

    def test_ids_of_panels_are_unique(self):
        for name, dashboard in self.all:
            self.assertEqual(repeated(panel["id"] for panel in panels_of(dashboard)), [], name)

    def test_ref_ids_are_unique(self):
        for where, panel in self.each_panel():
            self.assertEqual(repeated(target["refId"] for target in panel["targets"]), [], where)

    def test_panels_say_what_they_show(self):
        for where, panel in self.each_panel():
            self.assertTrue(panel["title"], where)
            self.assertTrue(panel["description"], where)
            self.assertTrue(panel["targets"], where)
            self.assertTrue(panel["fieldConfig"]["defaults"].get("unit"), where)

    def test_panels_lie_beside_each_other(self):
        for name, dashboard in self.all:
            panels = dashboard["panels"]
            for i, panel in enumerate(panels):
                place = panel["gridPos"]
                self.assertGreaterEqual(min(place["x"], place["y"]), 0, name)
                self.assertLessEqual(place["x"] + place["w"], 24, name)
                for other in panels[i + 1:]:
                    self.assertFalse(overlap(panel, other), (name, panel["title"], other["title"]))

    def test_the_datasource_is_a_variable(self):
        want = {"type": "prometheus", "uid": "${datasource}"}
        for where, panel in self.each_panel():
            self.assertEqual(panel["datasource"], want, where)
            for target in panel["targets"]:
                self.assertEqual(target["datasource"], want, where)
        for name, dashboard in self.all:
            first = dashboard["templating"]["list"][0]
            self.assertEqual((first["name"], first["type"]), ("datasource", "datasource"), name)

    def test_the_check_sees_an_overlap(self):
        here = {"gridPos": {"x": 0, "y": 0, "w": 8, "h": 8}}
        self.assertTrue(overlap(here, {"gridPos": {"x": 7, "y": 7, "w": 8, "h": 8}}))
        self.assertFalse(overlap(here, {"gridPos": {"x": 8, "y": 0, "w": 8, "h": 8}}))


if __name__ == "__main__":
    unittest.main()
