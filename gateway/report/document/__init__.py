"""The calibration report: one content model of frozen records, written as PDF and as HTML with the same content."""
