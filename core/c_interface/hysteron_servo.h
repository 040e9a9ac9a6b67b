/* The integer servo of Hysteron for C: see docs/reference/servo_schemes.md. */
#ifndef HYSTERON_SERVO_H
#define HYSTERON_SERVO_H
#include <stdint.h>

/* Bytes of the array that holds the block of `hysteron design --block`. */
#define HYSTERON_BLOCK_BYTES 2048

/* Memory of one servo; nothing else is allocated. */
typedef struct { uint64_t memory[1536]; } hysteron_servo;

/* Begins with a block, the loop open. 0: done; 1: a null pointer; 2: no block; 3: another version; 4: damaged;
   5: another sampling rate; 6: a value that no servo has. */
int32_t hysteron_servo_init(hysteron_servo *servo, const uint8_t block[HYSTERON_BLOCK_BYTES], uint32_t sample_rate_hz);

/* While the loop is open: every code that is written passes here first, so that the memory of the hysteresis is
   kept. Gives the code within the limits. */
uint32_t hysteron_servo_open_loop(hysteron_servo *servo, uint32_t drive_code);

/* Closes the loop at the next tick, from the drive and the position that are there. */
void hysteron_servo_enable(hysteron_servo *servo);

/* Once a sampling period: the code of the sensor, and where the stage shall be two periods later, um times 2^24.
   Gives the code of the drive. */
uint32_t hysteron_servo_tick(hysteron_servo *servo, uint32_t sensor_code, int32_t reference_ahead_q24);

/* So far: ticks at a limit of the drive, ticks beyond the reach of the hysteresis, values held in their format. */
void hysteron_servo_counters(const hysteron_servo *servo, uint32_t counters[3]);
#endif
