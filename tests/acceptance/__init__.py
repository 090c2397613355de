"""The shipped acceptance: what it sees, what it refuses, what it leaves out."""
