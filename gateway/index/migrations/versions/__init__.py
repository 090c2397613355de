"""The steps, one file each, in the order of their numbers; a file that was shipped is never changed."""
