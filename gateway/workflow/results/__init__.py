"""What a run ends with: its outcome on the console, its report and its data."""
