"""Messages that can carry a range, one file each and a row of `table`; `reader` makes range samples of them."""
