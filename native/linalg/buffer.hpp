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

// Large buffers are mapped by themselves, so that the system has them back at once when they are freed: the allocator
// would keep them, and the next factor of another size would come on top.
class Buffer {
public:
    Buffer() = default;
    explicit Buffer(int64_t size) : size_(size), bytes_(static_cast<size_t>(size > 0 ? size : 1) * sizeof(double)) {
        bytes_ = round_up(bytes_, 64);
#if defined(__linux__)
        if (bytes_ >= kMapped) {
            map();
            return;
        }
#endif
        data_ = static_cast<double*>(std::aligned_alloc(64, bytes_));
        if (data_ == nullptr) throw std::bad_alloc();
    }
    Buffer(Buffer&& other) noexcept { swap(other); }
    Buffer& operator=(Buffer&& other) noexcept {
        swap(other);
        return *this;
    }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    ~Buffer() {
#if defined(__linux__)
        if (bytes_ >= kMapped) {
            (void)munmap(data_, bytes_);
            return;
        }
#endif
        std::free(data_);
    }

    double* data() { return data_; }
    const double* data() const { return data_; }
    int64_t size() const { return size_; }

private:
    static constexpr size_t kMapped = size_t{1} << 21;
    static constexpr size_t kHuge = size_t{1} << 21;
    static constexpr size_t kPage = size_t{1} << 16;  // the largest that is common

    static size_t round_up(size_t n, size_t to) { return (n + to - 1) / to * to; }

    void swap(Buffer& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(bytes_, other.bytes_);
    }

#if defined(__linux__)
    void map() {
        bytes_ = round_up(bytes_, kPage);
        const bool huge = bytes_ >= 4 * kHuge;
        const size_t whole = bytes_ + (huge ? kHuge : 0);
        void* mapped = mmap(nullptr, whole, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (mapped == MAP_FAILED) throw std::bad_alloc();
        char* begin = static_cast<char*>(mapped);
        if (huge) {
            // Touching small pages one by one would cost a good part of a factorisation; a refusal does no harm.
            const size_t before = (kHuge - reinterpret_cast<uintptr_t>(begin) % kHuge) % kHuge;
            if (before > 0) (void)munmap(begin, before);
            if (before < kHuge) (void)munmap(begin + before + bytes_, kHuge - before);
            begin += before;
            (void)madvise(begin, bytes_, MADV_HUGEPAGE);
        }
        data_ = reinterpret_cast<double*>(begin);
    }
#endif

    double* data_ = nullptr;
    int64_t size_ = 0;
    size_t bytes_ = 0;
};

}  // namespace clew::linalg
