"""One file a vehicle, behind one contract (`interface`), and a row of `table`."""
