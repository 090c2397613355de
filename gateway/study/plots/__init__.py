"""What the paper and the library draw; called by the study's commands and by `plot()`. Each takes a figure and data."""
