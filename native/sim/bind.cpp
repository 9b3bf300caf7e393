#include "module.hpp"

namespace clew {

void bind_sim(nb::module_ m) { (void)m; }

}  // namespace clew
