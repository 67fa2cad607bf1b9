// Threads that share out the parts of a task; the caller is one of them.
#pragma once
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace pa {

class Team {
  public:
    explicit Team(int size) : size_(size), next_(size) {
        for (int i = 1; i < size; i++) threads_.emplace_back([this] { serve(); });
    }
    Team(const Team&) = delete;
    Team& operator=(const Team&) = delete;
    ~Team() {
        begin(nullptr, nullptr, size_);
        for (auto& thread : threads_) thread.join();
    }

    // f(i) for each i in [0, size), then returns. Whoever is free takes the next part, so that a
    // thread that another process keeps from running delays nothing that it has not begun.
    template <class F>
    void run(F& f) {
        unfinished_.store(size_, std::memory_order_relaxed);
        begin([](void* g, int i) { (*static_cast<F*>(g))(i); }, &f, 0);
        take_parts();
        while (unfinished_.load(std::memory_order_acquire) != 0) std::this_thread::yield();
    }

  private:
    using Task = void (*)(void*, int);
    static constexpr int kSpins = 100000;  // some tens of microseconds, then sleep

    // A new round; without a task, the last.
    void begin(Task task, void* argument, int first) {
        {
            const std::lock_guard<std::mutex> lock(mutex_);
            task_ = task, argument_ = argument, next_ = first;
            round_.fetch_add(1, std::memory_order_release);
        }
        if (!threads_.empty()) wake_.notify_all();
    }

    void take_parts() {
        std::unique_lock<std::mutex> lock(mutex_);
        while (next_ < size_) {
            const int part = next_++;
            const Task task = task_;
            void* argument = argument_;
            lock.unlock();
            task(argument, part);
            unfinished_.fetch_sub(1, std::memory_order_release);
            lock.lock();
        }
    }

    void serve() {
        for (uint64_t seen = 0;;) {
            for (int i = 0; i < kSpins && round_.load(std::memory_order_acquire) == seen; i++) {
            }
            {
                std::unique_lock<std::mutex> lock(mutex_);
                wake_.wait(lock, [&] { return round_.load(std::memory_order_acquire) != seen; });
                seen = round_.load(std::memory_order_acquire);
                if (!task_) return;
            }
            take_parts();
        }
    }

    const int size_;
    std::vector<std::thread> threads_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::atomic<uint64_t> round_{0};
    std::atomic<int> unfinished_{0};
    int next_;
    Task task_ = nullptr;
    void* argument_ = nullptr;
};

}  // namespace pa
