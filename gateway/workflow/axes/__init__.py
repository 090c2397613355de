"""One axis at a time: measure, propose a table, judge it afterwards, explain it, watch it, see it vibrate."""
