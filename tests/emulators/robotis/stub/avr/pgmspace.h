// Tables in flash are plain tables here.
#pragma once
#include <stdint.h>
#define PROGMEM
#define pgm_read_word_near(address) (*(const uint16_t*)(address))
