"""What a report says of errors and tooth: figures, rows, sentences and the part of the page that shows them."""
