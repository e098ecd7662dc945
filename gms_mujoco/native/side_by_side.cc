#include "side_by_side.h"

#include <condition_variable>
#include <mutex>
#include <thread>

#ifndef _WIN32
#include <pthread.h>
#endif

namespace gms {

namespace {

class Pool {
 public:
  void run(int threads, const std::function<void()>& work) {
    std::unique_lock<std::mutex> mine(taken_, std::try_to_lock);
    if (!mine) return work();
    {
      std::lock_guard<std::mutex> lock(mutex_);
      for (; begun_ < threads - 1; begun_++) std::thread(&Pool::wait, this).detach();
      work_ = &work;
      wanted_ = threads - 1;
    }
    wake_.notify_all();
    work();
    std::unique_lock<std::mutex> lock(mutex_);
    wanted_ = 0;  // who has not woken yet finds nothing to do
    done_.wait(lock, [this] { return busy_ == 0; });
  }

 private:
  void wait() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (true) {
      wake_.wait(lock, [this] { return wanted_ > 0; });
      wanted_--, busy_++;
      const auto* const work = work_;
      lock.unlock();
      (*work)();
      lock.lock();
      if (--busy_ == 0) done_.notify_one();
    }
  }

  std::mutex taken_, mutex_;  // held for a run; for what follows
  std::condition_variable wake_, done_;
  const std::function<void()>* work_ = nullptr;
  int begun_ = 0, wanted_ = 0, busy_ = 0;
};

// Never deleted: its threads wait until the process ends.
Pool* the_pool = nullptr;

}  // namespace

void side_by_side(int threads, const std::function<void()>& work) {
  if (threads < 2) return work();
  static std::once_flag begun;
  std::call_once(begun, [] {
    the_pool = new Pool;
#ifndef _WIN32
    pthread_atfork(nullptr, nullptr, [] { the_pool = new Pool; });  // a fork has one thread only
#endif
  });
  the_pool->run(threads, work);
}

}  // namespace gms
