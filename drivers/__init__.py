"""The outside world in our words: every instrument, controller and file format the gateway can meet."""
