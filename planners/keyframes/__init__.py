"""Plans of key frames (paper E eq. 11, §IV-B): the posture problem's terms, a frame each, coupled by steps."""
