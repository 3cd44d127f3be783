"""Messages that can carry a range: rows of `table`; `reader` makes range samples of them."""
