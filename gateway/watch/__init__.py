"""The watch folder: new result files are noticed, waited for until they are whole, and handed on once."""
