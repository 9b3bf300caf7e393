#include "module.hpp"

namespace clew {

void bind_scan(nb::module_ m) { (void)m; }

}  // namespace clew
