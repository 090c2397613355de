"""What people see while a command works: a live panel in a terminal, plain lines in a pipe, all of it in the log."""
