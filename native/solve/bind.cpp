#include "module.hpp"

namespace clew {

void bind_solve(nb::module_ m) { (void)m; }

}  // namespace clew
