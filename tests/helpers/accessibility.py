"""Accessibility checks of a page by axe-core."""

import json
from importlib import resources


def serious_findings(browser):
    """Return axe-core's serious and critical findings for the page in a browser.

    Each is the rule, and the first places where the page breaks it.
    """
    script = resources.files("axe_core_python") / "axe.min.js"
    browser.send("Runtime.evaluate", expression=script.read_text("utf-8"))
    found = browser.evaluate(
        "axe.run(document, {resultTypes: ['violations']}).then(found => JSON.stringify("
        "found.violations.filter(one => ['serious', 'critical'].includes(one.impact))"
        ".map(one => [one.id, one.help, one.nodes.slice(0, 4).map("
        "node => [node.target.join(' '), node.failureSummary])])))"
    )
    return json.loads(found)
