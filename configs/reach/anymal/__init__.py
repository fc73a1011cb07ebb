"""ANYmal, from loco-3d/sl1m (branch quadruped_update, b5bafa3), BSD 2-Clause, see LICENSE.txt."""
