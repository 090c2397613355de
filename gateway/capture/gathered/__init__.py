"""What a capture has gathered at the machine: its raw record, and how it is widened by more targets."""
