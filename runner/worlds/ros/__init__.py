"""A robot behind a rosbridge (extra ``ros``)."""
