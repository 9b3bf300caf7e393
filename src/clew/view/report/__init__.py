"""The report: one HTML file that shows what a run, a solve or a merge found; its door is `clew.view`."""
