"""The sensors at run time: from rows of ADC counts to tendon lengths with their sigma."""
