"""Programs at work: names, variables, statements, expressions, files, and the interpreter that walks them."""
