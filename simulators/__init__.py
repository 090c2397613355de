"""The world's double: a grinder, its control and its instruments, answering on real wires."""
