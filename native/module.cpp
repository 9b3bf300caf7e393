// The native module: one submodule a room, each bound in native/<room>/bind.cpp.
#include "module.hpp"

NB_MODULE(_native, m) {
    m.doc() = "Hot loops of clew; arrays in, arrays out. Import the Python rooms, not this.";
    clew::bind_isa(m);
    clew::bind_linalg(m.def_submodule("linalg"));
    clew::bind_solve(m.def_submodule("solve"));
    clew::bind_scan(m.def_submodule("scan"));
    clew::bind_mapping(m.def_submodule("mapping"));
    clew::bind_io(m.def_submodule("io"));
    clew::bind_sim(m.def_submodule("sim"));
}
