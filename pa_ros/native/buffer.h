// Zeroed floats that begin a cache line, owned. Compiled in a unit of its own: see level.h.
#pragma once
#include <cstdint>

namespace pa {

class Buffer {
  public:
    Buffer() = default;
    explicit Buffer(int64_t floats);  // Error if there is no memory
    ~Buffer();
    Buffer(Buffer&& other) noexcept;
    Buffer& operator=(Buffer&& other) noexcept;
    float* data() const;
    int64_t size() const;

  private:
    float* at_ = nullptr;
    int64_t size_ = 0;
};

}  // namespace pa
