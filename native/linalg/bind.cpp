#include "module.hpp"

namespace clew {

void bind_linalg(nb::module_ m) { (void)m; }

}  // namespace clew
