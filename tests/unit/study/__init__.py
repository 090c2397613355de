"""The studies as a command."""
