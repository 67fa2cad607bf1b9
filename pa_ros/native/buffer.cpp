#include "buffer.h"

#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>

#include "error.h"
#include "layout.h"

namespace pa {

Buffer::Buffer(int64_t floats) : size_(floats) {
    const size_t bytes = (size_t)padded(floats) * sizeof(float);
    at_ = static_cast<float*>(std::aligned_alloc(64, bytes));
    if (!at_) throw Error("expected memory for " + std::to_string(floats) + " floats, got none");
    std::memset(at_, 0, bytes);
}

Buffer::~Buffer() { std::free(at_); }

Buffer::Buffer(Buffer&& other) noexcept { *this = std::move(other); }

Buffer& Buffer::operator=(Buffer&& other) noexcept {
    std::swap(at_, other.at_);
    std::swap(size_, other.size_);
    return *this;
}

float* Buffer::data() const { return at_; }

int64_t Buffer::size() const { return size_; }

}  // namespace pa
