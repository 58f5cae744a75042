"""Made recordings of a teleoperated SO-101 with one hidden cause or none: does `lrm-ident checkup` name it?"""
