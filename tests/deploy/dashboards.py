"""Reads the dashboards that deploy/grafana/ ships."""
import json
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = ROOT / "deploy/grafana/dashboards"

# What Grafana fills in, and what it is for a server that runs for seconds.
VARIABLES = {
    "$__rate_interval": "1m",
    "$__interval": "1s",
    "$instance": ".*",
    "$map": ".*",
}


def load_all():
    """(file name, dashboard) pairs."""
    return [(path.name, json.loads(path.read_text())) for path in sorted(FOLDER.glob("*.json"))]


def panels_of(dashboard):
    """With the panels inside of rows that are folded."""
    for panel in dashboard["panels"]:
        yield panel
        yield from panel.get("panels", [])


def expressions_of(dashboard):
    """(panel's title, PromQL) pairs, with variables filled in."""
    for panel in panels_of(dashboard):
        for target in panel.get("targets", []):
            yield panel["title"], fill_in(target["expr"])


def fill_in(expression):
    for name, value in VARIABLES.items():
        expression = expression.replace(name, value)
    if "$" in expression:
        raise ValueError("a variable that the test does not know: " + expression)
    return expression


def metrics_of(expression):
    """Names of the metrics of ours, recorded ones included."""
    without_strings = re.sub(r'"[^"]*"', '""', expression)
    return set(re.findall(r"\b(?:gem|process|exposer)[_:][a-zA-Z0-9_:]+", without_strings))
