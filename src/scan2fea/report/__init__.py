"""report: the page, the console summary and the published schema of report.json; reads saved artifacts only."""
