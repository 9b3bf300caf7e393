#include "linalg/team.hpp"

#include <exception>

namespace clew::linalg {

Team::Team(size_t workers) {
    if (workers < 2) return;
    helpers_.reserve(workers - 1);
    try {
        for (size_t w = 1; w < workers; ++w) helpers_.emplace_back([this, w] { help(w); });
    } catch (const std::exception&) {  // no thread, or no memory for one
        // No more threads to be had: the work is done by those that there are.
    }
}

Team::~Team() {
    {
        const std::lock_guard lock(mutex_);
        stop_ = true;
    }
    begun_.notify_all();
    for (std::thread& helper : helpers_) helper.join();
}

void Team::run(size_t pieces, const std::function<void(size_t, size_t)>& work) {
    if (helpers_.empty() || pieces < 2) {
        for (size_t piece = 0; piece < pieces; ++piece) work(piece, 0);
        return;
    }
    std::unique_lock lock(mutex_);
    work_ = &work;
    pieces_ = pieces;
    next_ = 0;
    begun_.notify_all();
    while (next_ < pieces_) {
        const size_t piece = next_++;
        lock.unlock();
        work(piece, 0);
        lock.lock();
    }
    done_.wait(lock, [this] { return running_ == 0; });
    pieces_ = 0;
}

void Team::help(size_t worker) {
    std::unique_lock lock(mutex_);
    while (true) {
        begun_.wait(lock, [this] { return stop_ || next_ < pieces_; });
        if (stop_) return;
        const size_t piece = next_++;
        const auto* work = work_;
        ++running_;
        lock.unlock();
        (*work)(piece, worker);
        lock.lock();
        if (--running_ == 0 && next_ >= pieces_) done_.notify_one();
    }
}

}  // namespace clew::linalg
