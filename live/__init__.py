"""A live session: a rig's boards, a replay or the twin in, shapes as they come out."""
