"""Files of answers: problems and answers, plans, proofs and walks, read, judged and written.

Read ``plan_file``; the others are its like for walks, crossings, leaps, motions and proofs.
"""
