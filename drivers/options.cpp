#include "drivers/options.h"
