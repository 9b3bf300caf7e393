#include "module.hpp"

namespace clew {

void bind_io(nb::module_ m) { (void)m; }

}  // namespace clew
