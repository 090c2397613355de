"""A double of a SINUMERIK 840D sl NCK: it executes NC programs, moves axes and holds compensation tables."""
