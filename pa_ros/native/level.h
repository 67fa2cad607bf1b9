// The namespace of what is compiled once per instruction-set level. Nothing else of the library may
// have inline functions that those objects emit: the linker keeps one copy, of any level.
#pragma once
#include "layout.h"

#ifndef PA_LEVEL
#define PA_LEVEL generic
#endif
