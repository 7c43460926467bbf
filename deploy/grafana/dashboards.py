#!/usr/bin/env python3
"""Writes the Grafana dashboards: deploy/grafana/dashboards/*.json.

  deploy/grafana/dashboards.py            writes them
  deploy/grafana/dashboards.py --check    fails if they are not what it would write

Dashboards are code: positions, ids and units come out right by construction, and one line is one panel.
"""
import json
import pathlib
import sys

FOLDER = pathlib.Path(__file__).parent / "dashboards"
DATASOURCE = {"type": "prometheus", "uid": "${datasource}"}
GRID_COLUMNS = 24
OBJECTIVE = 0.99
STREAMS = 'method=~"WatchTiles|StreamTiles|WatchLocalMap"'
TILES = 'method=~"BatchGetTiles|WatchTiles|StreamTiles"'
READS = 'method=~"BatchGetTiles|GetLocalMap|GetTileMatrix"'


# What is asked. $instance and $map are the variables above each dashboard.
def of(name, *labels):
    return "%s{%s}" % (name, ", ".join(['instance=~"$instance"', *labels]))


def of_map(name, *labels):
    return of(name, 'map=~"$map"', *labels)


def rate(name, *labels):
    return "rate(%s[$__rate_interval])" % of(name, *labels)


def total(expression, by=""):
    return ("sum by (%s) (%s)" % (by, expression)) if by else "sum(%s)" % expression


def mean(name, *labels, by=""):
    return "%s / %s" % (total(rate(name + "_sum", *labels), by), total(rate(name + "_count", *labels), by))


def quantile(q, name, *labels, by="", window="$__rate_interval"):
    series = "rate(%s[%s])" % (of(name + "_bucket", *labels), window)
    return "histogram_quantile(%s, %s)" % (q, total(series, "le, " + by if by else "le"))


def or_zero(expression):
    return "%s or vector(0)" % expression


# How it is drawn.
def panel(kind, title, why, unit, queries, width=8, height=8, options=None, **defaults):
    """queries: (legend, expression) pairs."""
    targets = [
        {"refId": chr(ord("A") + i), "datasource": DATASOURCE, "expr": expression, "legendFormat": legend}
        for i, (legend, expression) in enumerate(queries)
    ]
    return {
        "type": kind,
        "title": title,
        "description": why,
        "datasource": DATASOURCE,
        "fieldConfig": {"defaults": {"unit": unit, **defaults}, "overrides": []},
        "options": options or {},
        "targets": targets,
        "gridPos": {"w": width, "h": height},
    }


def steps(*colors):
    """Colours from a value on; the first one from the beginning."""
    return {"mode": "absolute", "steps": [{"color": color, "value": value} for color, value in colors]}


def graph(title, why, unit, *queries, stacked=False, limit=None, **more):
    custom = {"fillOpacity": 30 if stacked else 8, "stacking": {"mode": "normal" if stacked else "none"}}
    if limit is not None:
        custom["thresholdsStyle"] = {"mode": "line"}
        more["thresholds"] = steps(("green", None), ("red", limit))
    options = {"legend": {"displayMode": "list", "placement": "bottom"}, "tooltip": {"mode": "multi"}}
    return panel("timeseries", title, why, unit, queries, options=options, custom=custom, min=0, **more)


def number(title, why, unit, expression, thresholds, legend="", **more):
    options = {
        "reduceOptions": {"calcs": ["lastNotNull"]},
        "colorMode": "background",
        "graphMode": "area",
        "textMode": "auto",
    }
    return panel("stat", title, why, unit, [(legend, expression)], width=more.pop("width", 4), height=5,
                 options=options, thresholds=thresholds, noValue="no work", **more)


def heatmap(title, why, name, *labels):
    made = panel("heatmap", title, why, "s",
                 [("{{le}}", total("increase(%s[$__rate_interval])" % of(name + "_bucket", *labels), "le"))],
                 options={"calculate": False, "yAxis": {"unit": "s"}, "color": {"scheme": "Oranges", "mode": "scheme"}})
    made["targets"][0]["format"] = "heatmap"
    return made


def row(title):
    return {"type": "row", "title": title, "collapsed": False, "panels": [], "gridPos": {"w": GRID_COLUMNS, "h": 1}}


GOOD_SHARE = steps(("red", None), ("orange", OBJECTIVE - 0.01), ("green", OBJECTIVE))
NEUTRAL = steps(("blue", None))


def objective(title, why, late):
    return number(title, why, "percentunit", "1 - " + of(late), GOOD_SHARE, legend="{{instance}}", max=1, decimals=2)


def overview():
    yield row("Objectives: 99 % within 100 ms, the period of scans")
    yield objective("Scans on time", "From the arrival of a scan to its place in the local map, last 5 minutes.",
                    "gem:scan_late:ratio_rate5m")
    yield objective("Reads on time", "BatchGetTiles and GetLocalMap, last 5 minutes.", "gem:read_late:ratio_rate5m")
    yield objective("Corrections on time", "From the arrival of a correction to the map that shows it, last hour.",
                    "gem:correction_late:ratio_rate1h")
    yield number("Map behind by", "Age of the oldest news that no published map shows.", "s",
                 "max(%s)" % of("gem_map_staleness_seconds"), steps(("green", None), ("orange", 1), ("red", 5)))
    yield number("Robots connected", "Sessions with a stream.", "short",
                 total(of("gem_sessions", 'state="connected"')), NEUTRAL)
    yield number("Alerts", "Alerts that fire.", "short", or_zero('count(ALERTS{alertstate="firing"})'),
                 steps(("green", None), ("red", 1)))
    yield row("Traffic")
    yield graph("Scans", "Scans by what became of them.", "cps",
                ("{{result}}", total(rate("gem_scans_total"), "result")))
    yield graph("Calls", "Calls that began, streams included.", "reqps",
                ("{{method}}", total(rate("gem_rpc_started_total"), "method")))
    yield graph("Bytes", "Messages before compression.", "Bps",
                ("{{direction}}", total(rate("gem_rpc_bytes_total"), "direction")))
    yield row("Errors")
    yield graph("Refused scans", "By reason; the robot is told which and why.", "cps",
                ("{{reason}}", total(rate("gem_scans_total", 'result="refused"'), "reason")))
    yield graph("Failed calls", "All codes but OK. Robots that lose their connection count as CANCELLED.", "reqps",
                ("{{code}}", or_zero(total(rate("gem_rpc_total", 'code!="OK"'), "code"))))
    yield graph("Availability", "Share of time in which the server answered Prometheus.", "percentunit",
                ("{{instance}}", "avg_over_time(%s[5m])" % of("up", 'job="gem_server"')), max=1)
    yield row("Latency")
    yield graph("Scan to local map", "The objective is the red line.", "s",
                ("median", quantile(0.5, "gem_scan_seconds")), ("99 %", quantile(0.99, "gem_scan_seconds")), limit=0.1)
    yield graph("Reads, 99 %", "The aim for tiles that are cached is 5 ms.", "s",
                ("{{method}}", quantile(0.99, "gem_rpc_seconds", READS, by="method")), limit=0.1)
    yield graph("Correction to published map", "The objective is the red line. Last 5 minutes.", "s",
                ("median", quantile(0.5, "gem_correction_seconds", window="5m")),
                ("99 %", quantile(0.99, "gem_correction_seconds", window="5m")), limit=0.1)
    yield row("Saturation")
    yield graph("Queues",
                "Bytes that wait for sessions; each is bounded by queue_bytes_max, all together by ingest_bytes_max.", "bytes",
                ("waiting", total(of("gem_queue_bytes"))))
    yield graph("Oldest scan", "Age of the oldest scan that waits or is in hand.", "s",
                ("age", "max(%s)" % of("gem_queue_oldest_seconds")), limit=1)
    yield graph("Processors", "Processors in use.", "short",
                ("{{instance}}", rate("process_cpu_seconds_total", 'job="gem_server"')))


def robots():
    yield row("Sessions")
    yield graph("Sessions", "alone: no stream; the session ends after session_idle_s_max.", "short",
                ("{{state}}", total(of("gem_sessions"), "state")), stacked=True)
    yield graph("Streams", "Ingest streams that are open.", "short",
                ("open", total(of("gem_rpc_active_calls", 'method="Ingest"'))))
    yield graph("Streams that began", "More than robots come: connections break.", "cpm",
                ("began", "60 * " + total(rate("gem_rpc_started_total", 'method="Ingest"'))))
    yield row("Scans")
    yield graph("Scans", "Scans by what became of them.", "cps",
                ("{{result}}", total(rate("gem_scans_total"), "result")), stacked=True)
    yield graph("Refused scans", "By reason; no_pose: odometry comes late or not at all.", "cps",
                ("{{reason}}", total(rate("gem_scans_total", 'result="refused"'), "reason")))
    yield graph("Share refused", "Of all scans that came, last 5 minutes.", "percentunit",
                ("{{instance}}", of("gem:scan_refused:ratio_rate5m")), limit=0.05)
    yield heatmap("Scan to local map", "From the arrival of a scan to its place in the local map.", "gem_scan_seconds")
    yield graph("Scan to local map", "Quantiles; the objective is the red line.", "s",
                *[(name, quantile(q, "gem_scan_seconds")) for name, q in (("median", 0.5), ("90 %", 0.9), ("99 %", 0.99))],
                limit=0.1)
    yield graph("Scans with time offsets", "as_it_comes: no poses covered the sweep, so it was not deskewed.", "cps",
                ("{{result}}", total(rate("gem_deskewed_scans_total"), "result")))
    yield row("Load")
    yield graph("Queues", "Bytes that wait for sessions.", "bytes", ("waiting", total(of("gem_queue_bytes"))))
    yield graph("Oldest scan", "Age of the oldest scan that waits or is in hand.", "s",
                ("age", "max(%s)" % of("gem_queue_oldest_seconds")), limit=1)
    yield graph("Received", "Bytes of scans and poses.", "Bps",
                ("scans and poses", total(rate("gem_rpc_bytes_total", 'method="Ingest"', 'direction="received"'))))
    yield graph("Bytes a point", "What a point costs on the way here, all fields and poses included.", "bytes",
                ("bytes", "%s / %s" % (
                    total(rate("gem_rpc_bytes_total", 'method="Ingest"', 'direction="received"')),
                    total(rate("gem_scan_points_total")))))
    yield graph("Points", "Points that came, whatever became of them.", "cps",
                ("points", total(rate("gem_scan_points_total"))))
    yield graph("Batches of poses", "Streamed odometry.", "cps",
                ("{{result}}", total(rate("gem_pose_batches_total"), "result")))


def local_mapper():
    stages = mean("gem_local_stage_seconds", by="stage")
    yield row("Time a scan")
    yield graph("Stages, mean", "Where the time of a scan goes.", "s", ("{{stage}}", stages), stacked=True)
    yield graph("Stages, 99 %", "Each stage by itself.", "s",
                ("{{stage}}", quantile(0.99, "gem_local_stage_seconds", by="stage")))
    yield graph("Processors", "Processors that the stages keep busy: what one more robot costs.", "short",
                ("{{stage}}", total(rate("gem_local_stage_seconds_sum"), "stage")), stacked=True)
    yield heatmap("Measure", "Noise model and transformation of each point.", "gem_local_stage_seconds",
                  'stage="measure"')
    yield heatmap("Fuse", "Sorting by cell and fusing.", "gem_local_stage_seconds", 'stage="fuse"')
    yield heatmap("Clear", "Ray table and look-ups.", "gem_local_stage_seconds", 'stage="clear"')
    yield row("What became of it")
    yield graph("Points by outcome", "gated: the point and the cell disagree.", "cps",
                ("{{outcome}}", total(rate("gem_scan_points_total"), "outcome")), stacked=True)
    yield graph("Share of points that are fused", "A fall means a window that is too small, or poses that are wrong.",
                "percentunit", ("fused", "%s / %s" % (total(rate("gem_scan_points_total", 'outcome="fused"')),
                                                      total(rate("gem_scan_points_total")))), max=1)
    yield graph("Points a scan", "Mean.", "short",
                ("points", "%s / %s" % (total(rate("gem_scan_points_total")),
                                        total(rate("gem_scans_total", 'result="fused"')))))
    yield graph("Cells by event", "evicted: left the window; cleared: a ray passed below; inflated: not seen there.",
                "cps", ("{{event}}", total(rate("gem_cells_total"), "event")), width=12)
    yield graph("Cells a scan", "Events of cells, divided by scans.", "short",
                ("{{event}}", "%s / ignoring(event) group_left %s" % (
                    total(rate("gem_cells_total"), "event"),
                    total(rate("gem_scans_total", 'result="fused"')))), width=12)


def global_map():
    yield row("Size: follows the area, not the path")
    for title, why, unit, name in (
            ("Submaps", "Finished and growing. Merging keeps them few where robots loop.", "short", "gem_submaps"),
            ("Cells", "Cells in submaps.", "short", "gem_points"),
            ("Memory of submaps", "Bytes.", "bytes", "gem_submap_bytes"),
            ("Tiles", "Tiles that hold cells.", "short", "gem_tiles")):
        yield graph(title, why, unit, ("{{map}}", total(of_map(name), "map")), width=6)
    yield row("How far readers are behind")
    yield graph("Staleness", "Age of the oldest news that no published map shows.", "s",
                ("{{map}}", "max by (map) (%s)" % of_map("gem_map_staleness_seconds")), limit=5)
    yield graph("Age of the newest revision", "Grows while no robot drives.", "s",
                ("{{map}}", "max by (map) (%s)" % of_map("gem_map_revision_age_seconds")))
    yield graph("Renderings", "cancelled: a newer correction came meanwhile.", "cps",
                ("{{result}}", total(rate("gem_commits_total"), "result")))
    yield row("Corrections")
    yield heatmap("Correction to published map", "The objective is 100 ms.", "gem_correction_seconds")
    yield graph("Tiles a correction", "Tiles that were rendered for it, last 5 minutes.", "short",
                ("median", quantile(0.5, "gem_correction_tiles", window="5m")),
                ("99 %", quantile(0.99, "gem_correction_tiles", window="5m")))
    yield graph("Corrections late", "Share that took longer than 100 ms, last hour.", "percentunit",
                ("{{instance}}", of("gem:correction_late:ratio_rate1h")), max=1, limit=0.05)
    yield graph("Corrections", "Corrections that were published.", "cpm",
                ("published", "60 * " + total(rate("gem_correction_seconds_count"))))
    yield graph("Waiting corrections", "Without an answer.", "short",
                ("{{map}}", total(of_map("gem_waiting_corrections"), "map")))
    yield graph("Oldest correction", "Age of the oldest one without an answer.", "s",
                ("{{map}}", "max by (map) (%s)" % of_map("gem_correction_oldest_seconds")), limit=10)
    yield row("Time a rendering")
    yield graph("Stages, mean", "Of the renderings in which they ran.", "s",
                ("{{stage}}", mean("gem_global_stage_seconds", by="stage")), stacked=True)
    yield graph("Stages, 99 %", "Each stage by itself.", "s",
                ("{{stage}}", quantile(0.99, "gem_global_stage_seconds", by="stage")))
    yield graph("Merged submaps", "Submaps that were merged into a neighbour.", "cpm",
                ("merged", "60 * " + total(rate("gem_merged_submaps_total"))))


def tiles():
    reads = ("BatchGetTiles", "GetTileMatrix", "GetLocalMap")
    yield row("Tiles")
    yield graph("Tiles", "absent: without known cells. not_modified: the client had it. key_only: no cells asked for.",
                "cps",
                ("{{outcome}}", total(rate("gem_tiles_served_total"), "outcome")), stacked=True)
    yield graph("Bytes a tile", "All layers that were asked for.", "bytes",
                ("bytes", "%s / %s" % (
                    total(rate("gem_rpc_bytes_total", TILES, 'direction="sent"')),
                    total(rate("gem_tiles_served_total", 'outcome="full"')))))
    yield graph("Sent", "Bytes of answers by method.", "Bps",
                ("{{method}}", total(rate("gem_rpc_bytes_total", 'direction="sent"'), "method")), stacked=True)
    yield row("Latency of reads")
    for method in reads:
        yield heatmap(method, "From the call to its answer.", "gem_rpc_seconds", 'method="%s"' % method)
    yield graph("Median", "By method.", "s", ("{{method}}", quantile(0.5, "gem_rpc_seconds", READS, by="method")))
    yield graph("99 %", "The aim for tiles that are cached is 5 ms.", "s",
                ("{{method}}", quantile(0.99, "gem_rpc_seconds", READS, by="method")), limit=0.1)
    yield graph("Share within 5 ms", "Of BatchGetTiles.", "percentunit",
                ("within 5 ms", "%s / %s" % (
                    total(rate("gem_rpc_seconds_bucket", 'method="BatchGetTiles"', 'le="0.005"')),
                    total(rate("gem_rpc_seconds_count", 'method="BatchGetTiles"')))), max=1)
    yield row("Streams to readers")
    yield graph("Streams", "WatchTiles, StreamTiles, WatchLocalMap; readers_max is the limit.", "short",
                ("{{method}}", total(of("gem_rpc_active_calls", STREAMS), "method")), stacked=True)
    yield graph("Messages", "Parts of changes, and local maps.", "cps",
                ("{{method}}", total(rate("gem_rpc_sent_messages_total", STREAMS), "method")), stacked=True)
    yield graph("Lag of the slowest", "Age of the oldest published change that some stream has not told its reader.", "s",
                ("{{instance}}", of("gem_watch_lag_seconds")))
    yield graph("Skipped versions", "Published, but replaced before a slow reader could take them.", "cps",
                ("skipped", total(rate("gem_watch_skipped_total"))))
    yield graph("Kept revisions", "Replaced ones that readers may still ask for.", "short",
                ("{{map}}", total(of_map("gem_replaced_revisions"), "map")))
    yield graph("Memory of kept revisions", "What only they hold; revision_bytes_max is the limit of each map.", "bytes",
                ("{{map}}", total(of_map("gem_replaced_revision_bytes"), "map")))
    yield row("Encoded tiles that are kept")
    yield graph("Hits", "Share of tiles and local maps that were encoded already.", "percentunit",
                ("hits", "%s / %s" % (total(rate("gem_tile_cache_requests_total", 'result="hit"')),
                                      total(rate("gem_tile_cache_requests_total")))), max=1)
    yield graph("Memory", "tile_cache_bytes_max is the limit.", "bytes",
                ("{{instance}}", of("gem_tile_cache_bytes")))
    yield graph("Evictions and late reads", "expired: a pinned version was not kept any more.", "cps",
                ("evicted", total(rate("gem_tile_cache_evictions_total"))),
                ("expired", total(rate("gem_expired_reads_total"))))
    yield row("All calls")
    yield graph("Calls that ended", "By method.", "reqps", ("{{method}}", total(rate("gem_rpc_total"), "method")))
    yield graph("In progress", "Calls and streams.", "short",
                ("{{method}}", total(of("gem_rpc_active_calls"), "method")), stacked=True)
    yield graph("Failed calls", "By method and code.", "reqps",
                ("{{method}} {{code}}", or_zero(total(rate("gem_rpc_total", 'code!="OK"'), "method, code"))))
    yield graph("Reads late", "Share that took longer than 100 ms, last 5 minutes.", "percentunit",
                ("{{instance}}", of("gem:read_late:ratio_rate5m")), max=1, limit=1 - OBJECTIVE, width=12)
    yield graph("Failed through no fault of the caller", "Share of all calls, last 5 minutes.", "percentunit",
                ("{{instance}}", of("gem:rpc_failed:ratio_rate5m")), max=1, limit=0.05, width=12)


def process():
    job = 'job="gem_server"'
    yield row("Process")
    yield number("Up since", "A restart empties the maps.", "dateTimeAsIso",
                 "1000 * " + of("process_start_time_seconds", job), NEUTRAL, legend="{{instance}}", width=8)
    yield number("Restarts", "Last 24 hours.", "short", "changes(%s[24h])" % of("process_start_time_seconds", job),
                 steps(("green", None), ("orange", 1)), legend="{{instance}}", width=8)
    yield number("Release", "What runs.", "short", total(of("gem_build_info"), "version"), NEUTRAL,
                 legend="{{version}}", width=8)
    yield graph("Processors", "Processors in use.", "short",
                ("{{instance}}", rate("process_cpu_seconds_total", job)))
    yield graph("Resident memory", "Memory that is in use.", "bytes",
                ("{{instance}}", of("process_resident_memory_bytes", job)))
    yield graph("Address space", "Grows with threads, says little by itself.", "bytes",
                ("{{instance}}", of("process_virtual_memory_bytes", job)))
    yield graph("Threads", "One per session and map, and gRPC's own.", "short",
                ("{{instance}}", of("process_threads", job)))
    yield graph("File descriptors", "One per connection.", "short", ("{{instance}}", of("process_open_fds", job)))
    yield graph("File descriptors in use", "Share of the limit.", "percentunit",
                ("{{instance}}", "%s / %s" % (of("process_open_fds", job), of("process_max_fds", job))), max=1,
                limit=0.8)
    yield row("Monitoring itself")
    yield graph("Scrape", "Time that Prometheus needs to fetch the page.", "s",
                ("{{instance}}", of("scrape_duration_seconds", job)))
    yield graph("Series", "Series on the page.", "short", ("{{instance}}", of("scrape_samples_scraped", job)))
    yield graph("Size of the page", "Bytes a scrape.", "bytes",
                ("{{instance}}", "%s / %s" % (rate("exposer_transferred_bytes_total"), rate("exposer_scrapes_total"))))


DASHBOARDS = (
    ("overview", "GEM overview", overview),
    ("robots", "GEM robots", robots),
    ("local_mapper", "GEM local mapper", local_mapper),
    ("global_map", "GEM global map", global_map),
    ("tiles", "GEM tiles", tiles),
    ("process", "GEM process", process),
)


def variable(name, kind, query, **more):
    asked = {} if kind == "datasource" else {"datasource": DATASOURCE, "includeAll": True, "multi": True,
                                             "allValue": ".*", "refresh": 2, "sort": 1,
                                             "current": {"text": "All", "value": "$__all"}}
    return {"name": name, "label": name, "type": kind, "query": query, **asked, **more}


def placed(panels):
    """From the left to the right, then the next line; every panel gets an id."""
    x = y = line_height = 0
    for i, made in enumerate(panels, start=1):
        place = made["gridPos"]
        if x + place["w"] > GRID_COLUMNS:
            x, y, line_height = 0, y + line_height, 0
        place.update(x=x, y=y)
        x, line_height = x + place["w"], max(line_height, place["h"])
        yield {"id": i, **made}


def dashboard(name, title, panels):
    variables = [variable("datasource", "datasource", "prometheus"),
                 variable("instance", "query", "label_values(gem_build_info, instance)")]
    if panels is global_map:
        variables.append(variable("map", "query", 'label_values(gem_tiles{instance=~"$instance"}, map)'))
    return {
        "uid": "gem-" + name.replace("_", "-"),
        "title": title,
        "tags": ["gem"],
        "schemaVersion": 38,
        "editable": False,
        "graphTooltip": 1,
        "refresh": "10s",
        "time": {"from": "now-1h", "to": "now"},
        "links": [{"type": "dashboards", "title": "GEM", "tags": ["gem"], "asDropdown": False, "keepTime": True,
                   "includeVars": True}],
        "templating": {"list": variables},
        "panels": list(placed(panels())),
    }


def main():
    check = sys.argv[1:] == ["--check"]
    if sys.argv[1:] and not check:
        sys.exit(__doc__)
    texts = {FOLDER / (name + ".json"): json.dumps(dashboard(name, title, panels), indent=1) + "\n"
             for name, title, panels in DASHBOARDS}
    if not check:
        FOLDER.mkdir(exist_ok=True)
        for path, text in texts.items():
            path.write_text(text)
        return
    stale = [path.name for path, text in texts.items() if not path.exists() or path.read_text() != text]
    stale += [path.name for path in FOLDER.glob("*.json") if path not in texts]
    if stale:
        sys.exit("not what deploy/grafana/dashboards.py writes: " + ", ".join(stale))


if __name__ == "__main__":
    main()
