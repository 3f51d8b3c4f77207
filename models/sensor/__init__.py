"""The sensors at run time: from rows of counts to tendon lengths with their sigma."""
