#include "module.hpp"

namespace clew {

void bind_mapping(nb::module_ m) { (void)m; }

}  // namespace clew
