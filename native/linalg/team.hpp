// A few threads that share pieces of work for as long as one factorisation takes.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace clew::linalg {

// The caller works along and never waits for a helper to wake up, only for pieces that one has begun: on a busy machine
// it does most of them itself. Idle helpers sleep.
class Team {
public:
    // With one worker there are no threads. Where the system gives fewer threads the team is smaller.
    explicit Team(size_t workers);
    ~Team();
    Team(const Team&) = delete;
    Team& operator=(const Team&) = delete;

    // work(piece, worker) for all pieces below `pieces`, each once, begun in ascending order. The caller is worker 0.
    // `work` must not throw.
    void run(size_t pieces, const std::function<void(size_t, size_t)>& work);

    size_t workers() const { return helpers_.size() + 1; }

    // More workers than this machine has processors would only wait for each other.
    static size_t most(size_t wanted) {
        const size_t processors = std::thread::hardware_concurrency();  // 0 where that is not known
        return processors == 0 ? wanted : std::min(wanted, processors);
    }

private:
    void help(size_t worker);

    std::mutex mutex_;
    std::condition_variable begun_, done_;
    const std::function<void(size_t, size_t)>* work_ = nullptr;
    size_t pieces_ = 0, next_ = 0, running_ = 0;
    bool stop_ = false;
    std::vector<std::thread> helpers_;
};

}  // namespace clew::linalg
