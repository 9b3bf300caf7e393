// Choice of the instruction set at run time.
//
// A file named `*_kernels.cpp` is compiled once for each level, inside `namespace clew::CLEW_ISA`
// (`base`, `avx2`, `avx512`), and the caller picks the copy by `isa_level()`. Such a file includes no heavy
// standard headers: an inline function of the standard library that is compiled there for AVX could be the
// copy that the linker keeps for everybody.
#pragma once

namespace clew {

enum class Isa { base = 0, avx2 = 1, avx512 = 2 };

// Best level that this machine runs. The environment variable CLEW_ISA (base, avx2, avx512) lowers it.
Isa isa_level();

}  // namespace clew

#if defined(__x86_64__) || defined(_M_X64)
#define CLEW_X86 1
// CLEW_DISPATCH(function): the copy of `function` for this machine.
#define CLEW_DISPATCH(function)                                             \
    (::clew::isa_level() == ::clew::Isa::avx512 ? ::clew::avx512::function  \
     : ::clew::isa_level() == ::clew::Isa::avx2 ? ::clew::avx2::function    \
                                                : ::clew::base::function)
// CLEW_DECLARE(declaration): declares the copies of one function.
#define CLEW_DECLARE(...)                    \
    namespace clew::base { __VA_ARGS__ }     \
    namespace clew::avx2 { __VA_ARGS__ }     \
    namespace clew::avx512 { __VA_ARGS__ }
#else
#define CLEW_DISPATCH(function) (::clew::base::function)
#define CLEW_DECLARE(...) namespace clew::base { __VA_ARGS__ }
#endif
