// Prints docs/configuration.md: granary_config_reference > docs/configuration.md
#include <iostream>

#include "config/reference.h"

int main() {
  std::cout << granary::ConfigReference();
  return std::cout.good() ? 0 : 1;
}
