#include "isa.hpp"

#include <cstdlib>
#include <cstring>

#include "module.hpp"

namespace clew {

namespace {

Isa detect() {
#ifdef CLEW_X86
    __builtin_cpu_init();
    Isa best = Isa::base;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        best = Isa::avx2;
        if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
            __builtin_cpu_supports("avx512vl")) {
            best = Isa::avx512;
        }
    }
    if (const char* wanted = std::getenv("CLEW_ISA")) {
        if (std::strcmp(wanted, "base") == 0) return Isa::base;
        if (std::strcmp(wanted, "avx2") == 0 && best > Isa::avx2) return Isa::avx2;
    }
    return best;
#else
    return Isa::base;
#endif
}

}  // namespace

Isa isa_level() {
    static const Isa level = detect();
    return level;
}

void bind_isa(nb::module_ m) {
    m.def("isa", [] {
        switch (isa_level()) {
            case Isa::avx512: return "avx512";
            case Isa::avx2: return "avx2";
            default: return "base";
        }
    }, "Instruction set that the kernels use on this machine.");
}

}  // namespace clew
