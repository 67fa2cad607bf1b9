// Threads that run the same function side by side; the caller is number 0.
#pragma once
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

namespace pa {

class Team {
  public:
    explicit Team(int size) {
        for (int i = 1; i < size; i++) threads_.emplace_back([this, i] { work(i); });
    }
    Team(const Team&) = delete;
    Team& operator=(const Team&) = delete;
    ~Team() {
        start([](void*, int) {}, nullptr, true);
        for (auto& thread : threads_) thread.join();
    }

    // f(i) for each i in [0, size), then returns.
    template <class F>
    void run(F& f) {
        if (!threads_.empty()) start([](void* g, int i) { (*static_cast<F*>(g))(i); }, &f, false);
        f(0);
        while (busy_.load(std::memory_order_acquire) != 0) std::this_thread::yield();
    }

  private:
    using Task = void (*)(void*, int);
    static constexpr int kSpins = 100000;  // some tens of microseconds, then sleep

    void start(Task task, void* argument, bool stop) {
        busy_.store((int)threads_.size(), std::memory_order_relaxed);
        {
            const std::lock_guard<std::mutex> lock(mutex_);
            task_ = task, argument_ = argument, stop_ = stop;
            round_.fetch_add(1, std::memory_order_release);
        }
        wake_.notify_all();
    }

    void work(int index) {
        for (uint64_t seen = 0;; seen++) {
            for (int i = 0; i < kSpins && round_.load(std::memory_order_acquire) == seen; i++) {
            }
            std::unique_lock<std::mutex> lock(mutex_);
            wake_.wait(lock, [&] { return round_.load(std::memory_order_acquire) != seen; });
            const Task task = task_;
            void* argument = argument_;
            const bool stop = stop_;
            lock.unlock();
            task(argument, index);
            busy_.fetch_sub(1, std::memory_order_release);
            if (stop) return;
        }
    }

    std::vector<std::thread> threads_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::atomic<uint64_t> round_{0};
    std::atomic<int> busy_{0};
    Task task_ = nullptr;
    void* argument_ = nullptr;
    bool stop_ = false;
};

}  // namespace pa
