"""Robot of a virtual KRC: axes, kinematics, corrections and drives, in deg and mm."""
