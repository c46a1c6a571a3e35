"""What plugins of points have in common, from views to drawings: objects whose feet, tops, ends or centres are mapped.

Objects are told apart by where its anchor (a foot on the floor, a centre below the ceiling) lies in a level plane. Its
tracks are named "pillar 1 / foot" and "pillar 1 / top"; the place of the first is {"pillar": 1, "part": "foot"}.
"""
