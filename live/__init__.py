"""A live session: estimates shapes while readings arrive from boards, a replay or the twin."""
