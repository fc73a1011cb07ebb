// As much of Arduino as ROBOTIS' packet code includes.
#pragma once
#include <stddef.h>
#include <stdint.h>
#include <string.h>
struct HardwareSerial {};
