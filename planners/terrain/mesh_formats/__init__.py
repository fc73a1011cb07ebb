"""Readers of mesh files: each takes a file's bytes and believes no count and no index in them.

A reader returns corners, shape (V, 3), in the file's unit, and triangles, shape (T, 3), of corners'
numbers. Polygons are cut in their planes, whatever their shape. Memory is asked for only as far as
the bytes go, and work grows with the file's size alone.
"""
