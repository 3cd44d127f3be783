"""Log readers, one file per format. `table` selects the reader by the content of a file."""
