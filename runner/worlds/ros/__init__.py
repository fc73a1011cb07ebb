"""A robot behind a rosbridge (extra ``machines``)."""
