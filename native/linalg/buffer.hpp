// Large uninitialised storage, aligned to cache lines.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <new>
#include <utility>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace clew::linalg {

class Buffer {
public:
    Buffer() = default;
    explicit Buffer(int64_t size) : size_(size) {
        constexpr size_t kHuge = size_t{1} << 21;
        size_t bytes = (static_cast<size_t>(size > 0 ? size : 1) * sizeof(double) + 63) / 64 * 64;
        const bool large = bytes >= 4 * kHuge;
        if (large) bytes = (bytes + kHuge - 1) / kHuge * kHuge;
        data_ = static_cast<double*>(std::aligned_alloc(large ? kHuge : 64, bytes));
        if (data_ == nullptr) throw std::bad_alloc();
#if defined(__linux__)
        // Touching small pages one by one would cost a good part of a factorisation; a refusal does no harm.
        if (large) (void)madvise(data_, bytes, MADV_HUGEPAGE);
#endif
    }
    Buffer(Buffer&& other) noexcept
        : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
    Buffer& operator=(Buffer&& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        return *this;
    }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    ~Buffer() { std::free(data_); }

    double* data() { return data_; }
    const double* data() const { return data_; }
    int64_t size() const { return size_; }

private:
    double* data_ = nullptr;
    int64_t size_ = 0;
};

}  // namespace clew::linalg
