"""Result files of vendors and tables of numbers, read into one record."""
