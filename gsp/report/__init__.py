"""The report: an `Analysis` to a folder with report.html, report.json and the figures."""

from __future__ import annotations

from gsp.report.content import as_json, choice_as_json, hyperbolicity_as_json
from gsp.report.folder import check_folder, write_report
from gsp.results.plain import plain

__all__ = ["as_json", "check_folder", "choice_as_json", "hyperbolicity_as_json", "plain", "write_report"]
