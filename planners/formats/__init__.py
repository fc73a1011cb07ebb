"""Files of questions, of motions and proofs, and of motions as tables, read, judged and written.

Read ``motion_file``, then ``question_file`` and ``table_file``.
"""
