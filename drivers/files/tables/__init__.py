"""A text of others as a table: where its heading stands, what its columns mean, which rows are readings; pure."""
