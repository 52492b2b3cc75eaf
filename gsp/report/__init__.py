"""The report: an `Analysis` to a folder with report.html, report.json and the figures."""

from __future__ import annotations

from gsp.report.content import as_json, hyperbolicity_as_json
from gsp.report.folder import check_folder, write_report

__all__ = ["as_json", "check_folder", "hyperbolicity_as_json", "write_report"]
